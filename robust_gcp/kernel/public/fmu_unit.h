// The mechanism as a unit for co-simulation on robust_gcp.h, whichever version of the standard asks: the library is the
// unit's binary, and the mechanism lies beside it as resources/mechanism.rgcp. See export/fmu.py, which writes the
// variables' numbers alike.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "robust_gcp.h"

namespace fmu {

enum Status { OK, WARNING, DISCARD, ERROR, FATAL };  // as both versions have them
using Reference = std::uint32_t;
using Bytes = std::vector<unsigned char>;

constexpr Reference INPUT = 0, CONTROL = 100000, Q = 200000, V = 300000, CROSSINGS = 400000, TIME = 500000;

class Unit {
  public:
    using Log = std::function<void(int, const char*)>;

    // Null where there is none, of which the log has the reason. `at` is the folder of resources.
    static Unit* made(const std::string& at, Log log) {
        try {
            std::unique_ptr<Unit> unit(new Unit);
            unit->log_ = std::move(log);
            char why[300] = "";
            unit->mechanism_ = rgcp_open((at + "/mechanism.rgcp").c_str(), why, sizeof why);
            if (unit->mechanism_ == nullptr) return unit->fail(ERROR, why), nullptr;
            if (unit->reset() != OK) return nullptr;
            const rgcp_counts n = rgcp_count(unit->mechanism_);
            unit->tau_.resize(static_cast<std::size_t>(n.nv)), unit->control_.resize(static_cast<std::size_t>(n.controls));
            std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen((at + "/step.txt").c_str(), "r"), std::fclose);
            if (!file || std::fscanf(file.get(), "%lf", &unit->step_) != 1 || !(unit->step_ > 0.0))
                return unit->fail(ERROR, "resources/step.txt is missing"), nullptr;
            return unit.release();
        } catch (const std::exception&) {
            return nullptr;
        }
    }
    ~Unit() {
        rgcp_free(motion_);
        rgcp_close(mechanism_);
    }

    int fail(int status, const char* what) const {
        if (log_) log_(status, what);
        return status;
    }

    int begin(double start) {
        return rgcp_begin(motion_, nullptr, nullptr, start) == RGCP_OK ? OK : fail(ERROR, rgcp_why(motion_));
    }
    // As it was made: the motion has to begin again, where `start` says anew.
    int reset() {
        std::fill(tau_.begin(), tau_.end(), 0.0);
        std::fill(control_.begin(), control_.end(), 0.0);
        controlled_ = false, start = 0.0;
        char why[300] = "";
        rgcp_motion* motion = rgcp_new(mechanism_, why, sizeof why);
        if (motion == nullptr) return fail(ERROR, why);
        rgcp_free(std::exchange(motion_, motion));
        return OK;
    }
    double start = 0.0;  // where the experiment begins, which FMI 2.0 tells before the motion does
    double time() const { return rgcp_time(motion_); }

    int get(const Reference* which, std::size_t count, double* values) {
        const rgcp_counts n = rgcp_count(mechanism_);
        for (std::size_t i = 0; i < count; ++i) {
            const Reference r = which[i];
            if (const double* given = input(r))
                values[i] = *given;
            else if (r >= Q && r < Q + static_cast<Reference>(n.nq))
                values[i] = rgcp_q(motion_)[r - Q];
            else if (r >= V && r < V + static_cast<Reference>(n.nv))
                values[i] = rgcp_v(motion_)[r - V];
            else if (r == TIME)
                values[i] = time();
            else
                return fail(ERROR, "there is no such real variable");
        }
        return OK;
    }
    int get(const Reference* which, std::size_t count, std::int32_t* values) {
        for (std::size_t i = 0; i < count; ++i) {
            if (which[i] != CROSSINGS) return fail(ERROR, "there is no such integer variable");
            values[i] = static_cast<std::int32_t>(rgcp_crossings(motion_));
        }
        return OK;
    }
    int set(const Reference* which, std::size_t count, const double* values) {
        for (std::size_t i = 0; i < count; ++i) {
            double* given = input(which[i]);
            if (given == nullptr) return fail(ERROR, "this variable is no input");
            if (!std::isfinite(values[i])) return fail(DISCARD, "an input must be finite");
            *given = values[i];
            controlled_ = controlled_ || which[i] >= CONTROL;
        }
        return OK;
    }

    int step(double size) {
        if (!(size > 0.0)) return fail(DISCARD, "a step must be positive");
        const double count = std::max(1.0, std::ceil(size / step_ * (1.0 - 1e-9)));
        const double h = std::fabs(count * step_ - size) <= 1e-9 * size ? step_ : size / count;
        const rgcp_status status =
            rgcp_step(motion_, h, static_cast<std::int64_t>(count), tau_.data(), controlled_ ? control_.data() : nullptr);
        return status == RGCP_OK ? OK : fail(status == RGCP_STOPPED ? DISCARD : ERROR, rgcp_why(motion_));
    }

    // A state: the inputs, and the motion's bytes after them.
    int take(void** state) {
        try {
            const std::size_t size = rgcp_state_size(motion_);
            Bytes whole(inputs() + size);
            unsigned char* to = whole.data();
            for (const std::vector<double>* part : {&tau_, &control_}) {
                if (!part->empty()) std::memcpy(to, part->data(), part->size() * sizeof(double));
                to += part->size() * sizeof(double);
            }
            std::memcpy(to, &controlled_, sizeof controlled_);
            if (rgcp_save(motion_, whole.data() + inputs(), size) != RGCP_OK) return fail(ERROR, rgcp_why(motion_));
            if (*state != nullptr)
                static_cast<Bytes*>(*state)->swap(whole);
            else
                *state = new Bytes(std::move(whole));
            return OK;
        } catch (const std::exception&) {
            return fail(ERROR, "no memory for the state");
        }
    }
    int put(const void* state) {
        const Bytes& whole = *static_cast<const Bytes*>(state);
        if (whole.size() < inputs()) return fail(ERROR, "these bytes are no state of this unit");
        if (rgcp_restore(motion_, whole.data() + inputs(), whole.size() - inputs()) != RGCP_OK)
            return fail(ERROR, rgcp_why(motion_));
        const unsigned char* from = whole.data();
        for (std::vector<double>* part : {&tau_, &control_}) {
            if (!part->empty()) std::memcpy(part->data(), from, part->size() * sizeof(double));
            from += part->size() * sizeof(double);
        }
        std::memcpy(&controlled_, from, sizeof controlled_);
        return OK;
    }
    static int release(void** state) {
        delete static_cast<Bytes*>(*state);
        *state = nullptr;
        return OK;
    }
    static int measure(const void* state, std::size_t* size) { return *size = static_cast<const Bytes*>(state)->size(), OK; }
    int write(const void* state, void* bytes, std::size_t size) const {
        const Bytes& whole = *static_cast<const Bytes*>(state);
        if (size < whole.size()) return fail(ERROR, "too little room for the state");
        std::memcpy(bytes, whole.data(), whole.size());
        return OK;
    }
    int read(const void* bytes, std::size_t size, void** state) const {
        try {
            const unsigned char* from = static_cast<const unsigned char*>(bytes);
            *state = new Bytes(from, from + size);
            return OK;
        } catch (const std::exception&) {
            return fail(ERROR, "no memory for the state");
        }
    }

  private:
    Unit() = default;

    double* input(Reference r) {
        const Reference nv = static_cast<Reference>(tau_.size()), nc = static_cast<Reference>(control_.size());
        if (r < nv) return &tau_[r];
        return r >= CONTROL && r < CONTROL + nc ? &control_[r - CONTROL] : nullptr;
    }
    std::size_t inputs() const { return (tau_.size() + control_.size()) * sizeof(double) + sizeof(bool); }

    Log log_;
    rgcp_mechanism* mechanism_ = nullptr;
    rgcp_motion* motion_ = nullptr;
    std::vector<double> tau_, control_;
    double step_ = 1e-3;
    bool controlled_ = false;
};

inline Unit& of(void* component) { return *static_cast<Unit*>(component); }

}  // namespace fmu

#define FMI extern "C" __attribute__((visibility("default")))
