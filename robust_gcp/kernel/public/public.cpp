// The functions of robust_gcp.h. No exception leaves them, and nothing is global.
#include <cstdio>
#include <memory>
#include <new>
#include <stdexcept>
#include <vector>

#include "exports.h"
#include "linalg/memory.h"
#include "public/image.h"
#include "public/public_motion.h"

struct rgcp_mechanism {
    explicit rgcp_mechanism(const std::vector<unsigned char>& bytes) : image(bytes.data(), bytes.size()) {}
    const rg::Image image;
    const rg::Exported& root() const { return image.root(); }
};

// All that it takes lies in its own budget, where there is one.
struct rgcp_motion {
    rgcp_motion(const rgcp_mechanism& of, std::size_t bytes) : budget(bytes > 0 ? new rg::Budget(bytes) : nullptr) {
        const rg::Within own(budget.get());
        motion.reset(new rg::PublicMotion(of.root()));
    }
    ~rgcp_motion() {
        const rg::Within own(budget.get());
        motion.reset();
    }
    const std::unique_ptr<rg::Budget> budget;
    std::unique_ptr<rg::PublicMotion> motion;
};

namespace {

std::vector<unsigned char> contents(const char* path) {
    if (path == nullptr) throw std::runtime_error("no path is given");
    std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path, "rb"), std::fclose);
    if (!file) throw std::runtime_error("the file cannot be opened");
    std::vector<unsigned char> bytes;
    unsigned char part[4096];
    for (std::size_t n; (n = std::fread(part, 1, sizeof part, file.get())) > 0;) bytes.insert(bytes.end(), part, part + n);
    if (std::ferror(file.get())) throw std::runtime_error("the file cannot be read");
    return bytes;
}

template <typename Make>
auto made(char* why, std::size_t length, Make make) -> decltype(make()) {
    try {
        return make();
    } catch (const std::exception& error) {
        if (why != nullptr && length > 0) std::snprintf(why, length, "%s", error.what());
        return nullptr;
    }
}

template <typename Do>
rgcp_status guarded(rgcp_motion* motion, Do what) {
    if (motion == nullptr) return RGCP_BAD_ARGUMENT;
    const rg::Within own(motion->budget.get());
    try {
        return what(*motion->motion);
    } catch (const std::bad_alloc&) {
        motion->motion->give_up();
        return motion->motion->fail(RGCP_NO_MEMORY, motion->budget ? "the bytes given to rgcp_new_within are used up" : "no memory is left");
    } catch (const std::exception& error) {
        return motion->motion->fail(RGCP_STOPPED, error.what());
    }
}

}  // namespace

#define RGCP extern "C" __attribute__((visibility("default")))

RGCP int32_t rgcp_api() { return RGCP_API; }
RGCP rgcp_mechanism* rgcp_open(const char* path, char* why, size_t length) {
    return made(why, length, [&] { return new rgcp_mechanism(contents(path)); });
}
RGCP rgcp_mechanism* rgcp_open_bytes(const void* bytes, size_t size, char* why, size_t length) {
    return made(why, length, [&] {
        const unsigned char* from = static_cast<const unsigned char*>(bytes);
        if (from == nullptr) throw std::runtime_error("no bytes are given");
        return new rgcp_mechanism({from, from + size});
    });
}
RGCP void rgcp_close(rgcp_mechanism* mechanism) { delete mechanism; }
RGCP rgcp_counts rgcp_count(const rgcp_mechanism* mechanism) {
    const rg::Exported& e = mechanism->root();
    const rg::Description& d = *e.chart[0]->description;
    return {d.nq, d.nv, d.m, e.controls, e.charts};
}
RGCP const char* rgcp_joints(const rgcp_mechanism* mechanism) { return mechanism->root().joints; }
RGCP const char* rgcp_actuators(const rgcp_mechanism* mechanism) { return mechanism->root().actuators; }
RGCP const double* rgcp_home(const rgcp_mechanism* mechanism) { return mechanism->root().chart[0]->description->home; }
RGCP const int32_t* rgcp_independent(const rgcp_mechanism* mechanism, int32_t chart) {
    const rg::Exported& e = mechanism->root();
    return chart < 0 || chart >= e.charts ? nullptr : e.chart[chart]->description->independent;
}

RGCP rgcp_motion* rgcp_new(const rgcp_mechanism* mechanism, char* why, size_t length) {
    return rgcp_new_within(mechanism, 0, why, length);
}
RGCP rgcp_motion* rgcp_new_within(const rgcp_mechanism* mechanism, size_t bytes, char* why, size_t length) {
    return made(why, length, [&] {
        if (mechanism == nullptr) throw std::runtime_error("no mechanism is given");
        try {
            return new rgcp_motion(*mechanism, bytes);
        } catch (const std::bad_alloc&) {
            throw std::runtime_error("no memory for the motion: too few bytes, or the system has none");
        }
    });
}
RGCP size_t rgcp_used(const rgcp_motion* motion) { return motion->budget ? motion->budget->used() : 0; }
RGCP rgcp_status rgcp_prepare(rgcp_motion* motion) {
    return guarded(motion, [](rg::PublicMotion& m) { return m.prepare(); });
}
RGCP void rgcp_free(rgcp_motion* motion) { delete motion; }
RGCP const char* rgcp_why(const rgcp_motion* motion) { return motion->motion->why(); }
RGCP rgcp_status rgcp_begin(rgcp_motion* motion, const double* q, const double* u, double t) {
    return guarded(motion, [&](rg::PublicMotion& m) { return m.begin(q, u, t); });
}
RGCP rgcp_status rgcp_step(rgcp_motion* motion, double h, int64_t n, const double* tau, const double* control) {
    return guarded(motion, [&](rg::PublicMotion& m) { return m.step(h, n, tau, control); });
}
RGCP double rgcp_time(const rgcp_motion* motion) { return motion->motion->time(); }
RGCP int32_t rgcp_chart(const rgcp_motion* motion) { return motion->motion->chart(); }
RGCP int64_t rgcp_crossings(const rgcp_motion* motion) { return motion->motion->crossings(); }
RGCP const double* rgcp_q(const rgcp_motion* motion) { return motion->motion->q.data(); }
RGCP const double* rgcp_v(const rgcp_motion* motion) { return motion->motion->v.data(); }
RGCP const double* rgcp_y(const rgcp_motion* motion) { return motion->motion->x.data(); }
RGCP const double* rgcp_acceleration(const rgcp_motion* motion) { return motion->motion->ydd.data(); }
RGCP const double* rgcp_G(const rgcp_motion* motion) { return motion->motion->G(); }
RGCP const double* rgcp_g(const rgcp_motion* motion) { return motion->motion->g(); }
RGCP rgcp_status rgcp_reduced(rgcp_motion* motion, double* M, double* b) {
    return guarded(motion, [&](rg::PublicMotion& m) { return m.reduced(M, b); });
}
RGCP rgcp_status rgcp_derivatives(rgcp_motion* motion, const double* tau, double* acceleration, double* rows) {
    return guarded(motion, [&](rg::PublicMotion& m) { return m.derivatives(tau, acceleration, rows); });
}
RGCP size_t rgcp_state_size(rgcp_motion* motion) {
    const rg::Within own(motion->budget.get());
    return motion->motion->save(nullptr, 0);
}
RGCP rgcp_status rgcp_save(rgcp_motion* motion, void* bytes, size_t size) {
    return guarded(motion, [&](rg::PublicMotion& m) {
        const size_t needed = m.save(static_cast<unsigned char*>(bytes), size);
        const bool room = bytes != nullptr && needed > 0 && needed <= size;
        return room ? RGCP_OK : m.fail(RGCP_BAD_ARGUMENT, needed > 0 ? "too little room" : "nothing has begun");
    });
}
RGCP rgcp_status rgcp_restore(rgcp_motion* motion, const void* bytes, size_t size) {
    return guarded(motion, [&](rg::PublicMotion& m) { return m.restore(static_cast<const unsigned char*>(bytes), size); });
}
