// The mechanism as a unit for co-simulation (FMI 2.0) on robust_gcp.h; the library is the unit's binary, and the
// mechanism lies beside it as resources/mechanism.rgcp. See export/fmu.py, which writes the variables' numbers alike.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include "exports.h"
#include "robust_gcp.h"

namespace {

// As the standard has them.
enum Status { OK, WARNING, DISCARD, ERROR, FATAL, PENDING };
using Reference = unsigned int;
using Logger = void (*)(void*, const char*, int, const char*, const char*, ...);
struct Callbacks {
    Logger logger;
    void* (*allocate)(std::size_t, std::size_t);
    void (*release)(void*);
    void (*finished)(void*, int);
    void* environment;
};

constexpr Reference INPUT = 0, CONTROL = 100000, Q = 200000, V = 300000, CROSSINGS = 400000;

struct Unit {
    std::string name;
    const Callbacks* callbacks = nullptr;
    rgcp_mechanism* mechanism = nullptr;
    rgcp_motion* motion = nullptr;
    std::vector<double> tau, control;
    double step = 1e-3, start = 0.0;
    bool controlled = false;

    ~Unit() {
        rgcp_free(motion);
        rgcp_close(mechanism);
    }
    int fail(int status, const char* what) const {
        if (callbacks != nullptr && callbacks->logger != nullptr)
            callbacks->logger(callbacks->environment, name.c_str(), status, "error", "%s", what);
        return status;
    }
    double* input(Reference r) {
        const Reference nv = static_cast<Reference>(tau.size()), nc = static_cast<Reference>(control.size());
        if (r < nv) return &tau[r];
        return r >= CONTROL && r < CONTROL + nc ? &control[r - CONTROL] : nullptr;
    }
};

// The folder of resources, from its address.
std::string folder(const char* address) {
    std::string text = address == nullptr ? "" : address, found;
    if (text.compare(0, 5, "file:") == 0) text = text.substr(text.compare(0, 7, "file://") == 0 ? 7 : 5);
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] == '%' && i + 2 < text.size()) {
            found += static_cast<char>(std::strtol(text.substr(i + 1, 2).c_str(), nullptr, 16));
            i += 2;
        } else {
            found += text[i];
        }
    }
    return found;
}

Unit* unit(void* component) { return static_cast<Unit*>(component); }

}  // namespace

#define FMI extern "C" __attribute__((visibility("default")))

FMI const char* fmi2GetTypesPlatform() { return "default"; }
FMI const char* fmi2GetVersion() { return "2.0"; }
FMI int fmi2SetDebugLogging(void*, int, std::size_t, const char* const*) { return OK; }

FMI void* fmi2Instantiate(const char* name, int type, const char*, const char* resources, const Callbacks* callbacks, int,
                          int) {
    try {
        std::unique_ptr<Unit> made(new Unit);
        made->name = name == nullptr ? "" : name, made->callbacks = callbacks;
        const std::string at = folder(resources);
        char why[300] = "";
        if (type != 1) return made->fail(ERROR, "it is a unit for co-simulation"), nullptr;
        made->mechanism = rgcp_open((at + "/mechanism.rgcp").c_str(), why, sizeof why);
        if (made->mechanism != nullptr) made->motion = rgcp_new(made->mechanism, why, sizeof why);
        if (made->motion == nullptr) return made->fail(ERROR, why), nullptr;
        const rgcp_counts n = rgcp_count(made->mechanism);
        made->tau.resize(static_cast<std::size_t>(n.nv)), made->control.resize(static_cast<std::size_t>(n.controls));
        std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen((at + "/step.txt").c_str(), "r"), std::fclose);
        if (!file || std::fscanf(file.get(), "%lf", &made->step) != 1 || !(made->step > 0.0))
            return made->fail(ERROR, "resources/step.txt is missing"), nullptr;
        return made.release();
    } catch (const std::exception&) {
        return nullptr;
    }
}
FMI void fmi2FreeInstance(void* component) { delete unit(component); }
FMI int fmi2SetupExperiment(void* component, int, double, double start, int, double) {
    unit(component)->start = start;
    return OK;
}
FMI int fmi2EnterInitializationMode(void* component) {
    Unit& u = *unit(component);
    return rgcp_begin(u.motion, nullptr, nullptr, u.start) == RGCP_OK ? OK : u.fail(ERROR, rgcp_why(u.motion));
}
FMI int fmi2ExitInitializationMode(void*) { return OK; }
FMI int fmi2Terminate(void*) { return OK; }
FMI int fmi2Reset(void* component) {
    Unit& u = *unit(component);
    std::fill(u.tau.begin(), u.tau.end(), 0.0);
    std::fill(u.control.begin(), u.control.end(), 0.0);
    u.controlled = false;
    return OK;
}

FMI int fmi2GetReal(void* component, const Reference* which, std::size_t count, double* values) {
    Unit& u = *unit(component);
    const rgcp_counts n = rgcp_count(u.mechanism);
    for (std::size_t i = 0; i < count; ++i) {
        const Reference r = which[i];
        if (const double* input = u.input(r))
            values[i] = *input;
        else if (r >= Q && r < Q + static_cast<Reference>(n.nq))
            values[i] = rgcp_q(u.motion)[r - Q];
        else if (r >= V && r < V + static_cast<Reference>(n.nv))
            values[i] = rgcp_v(u.motion)[r - V];
        else
            return u.fail(ERROR, "there is no such real variable");
    }
    return OK;
}
FMI int fmi2GetInteger(void* component, const Reference* which, std::size_t count, int* values) {
    Unit& u = *unit(component);
    for (std::size_t i = 0; i < count; ++i) {
        if (which[i] != CROSSINGS) return u.fail(ERROR, "there is no such integer variable");
        values[i] = static_cast<int>(rgcp_crossings(u.motion));
    }
    return OK;
}
FMI int fmi2SetReal(void* component, const Reference* which, std::size_t count, const double* values) {
    Unit& u = *unit(component);
    for (std::size_t i = 0; i < count; ++i) {
        double* input = u.input(which[i]);
        if (input == nullptr) return u.fail(ERROR, "this variable is no input");
        if (!std::isfinite(values[i])) return u.fail(DISCARD, "an input must be finite");
        *input = values[i];
        u.controlled = u.controlled || which[i] >= CONTROL;
    }
    return OK;
}

FMI int fmi2DoStep(void* component, double, double size, int) {
    Unit& u = *unit(component);
    if (!(size > 0.0)) return u.fail(DISCARD, "a step must be positive");
    const double count = std::max(1.0, std::ceil(size / u.step * (1.0 - 1e-9)));
    const double h = std::fabs(count * u.step - size) <= 1e-9 * size ? u.step : size / count;
    const rgcp_status status =
        rgcp_step(u.motion, h, static_cast<std::int64_t>(count), u.tau.data(), u.controlled ? u.control.data() : nullptr);
    return status == RGCP_OK ? OK : u.fail(status == RGCP_STOPPED ? DISCARD : ERROR, rgcp_why(u.motion));
}

// States: the motion's bytes, with the inputs before them.
namespace {
std::size_t inputs_of(const Unit& u) { return (u.tau.size() + u.control.size()) * sizeof(double) + sizeof(bool); }
}  // namespace
FMI int fmi2SerializedFMUstateSize(void*, void* state, std::size_t* size) {
    *size = static_cast<std::vector<char>*>(state)->size();
    return OK;
}
FMI int fmi2SerializeFMUstate(void* component, void* state, char* bytes, std::size_t size) {
    const std::vector<char>& whole = *static_cast<std::vector<char>*>(state);
    if (size < whole.size()) return unit(component)->fail(ERROR, "too little room for the state");
    std::memcpy(bytes, whole.data(), whole.size());
    return OK;
}
FMI int fmi2DeSerializeFMUstate(void* component, const char* bytes, std::size_t size, void** state) {
    try {
        *state = new std::vector<char>(bytes, bytes + size);
        return OK;
    } catch (const std::exception&) {
        return unit(component)->fail(ERROR, "no memory for the state");
    }
}
FMI int fmi2GetFMUstate(void* component, void** state) {
    Unit& u = *unit(component);
    try {
        const std::size_t inputs = inputs_of(u), size = rgcp_state_size(u.motion);
        std::vector<char> whole(inputs + size);
        char* to = whole.data();
        for (const std::vector<double>* part : {&u.tau, &u.control}) {
            if (!part->empty()) std::memcpy(to, part->data(), part->size() * sizeof(double));
            to += part->size() * sizeof(double);
        }
        std::memcpy(to, &u.controlled, sizeof u.controlled);
        if (rgcp_save(u.motion, whole.data() + inputs, size) != RGCP_OK) return u.fail(ERROR, rgcp_why(u.motion));
        if (*state != nullptr)
            static_cast<std::vector<char>*>(*state)->swap(whole);
        else
            *state = new std::vector<char>(std::move(whole));
        return OK;
    } catch (const std::exception&) {
        return u.fail(ERROR, "no memory for the state");
    }
}
FMI int fmi2SetFMUstate(void* component, void* state) {
    Unit& u = *unit(component);
    const std::vector<char>& whole = *static_cast<std::vector<char>*>(state);
    const std::size_t inputs = inputs_of(u);
    if (whole.size() < inputs) return u.fail(ERROR, "these bytes are no state of this unit");
    if (rgcp_restore(u.motion, whole.data() + inputs, whole.size() - inputs) != RGCP_OK)
        return u.fail(ERROR, rgcp_why(u.motion));
    const char* from = whole.data();
    for (std::vector<double>* part : {&u.tau, &u.control}) {
        if (!part->empty()) std::memcpy(part->data(), from, part->size() * sizeof(double));
        from += part->size() * sizeof(double);
    }
    std::memcpy(&u.controlled, from, sizeof u.controlled);
    return OK;
}
FMI int fmi2FreeFMUstate(void*, void** state) {
    delete static_cast<std::vector<char>*>(*state);
    *state = nullptr;
    return OK;
}

// What the unit has none of.
FMI int fmi2GetBoolean(void* c, const Reference*, std::size_t count, int*) {
    return count == 0 ? OK : unit(c)->fail(ERROR, "there are no Boolean variables");
}
FMI int fmi2GetString(void* c, const Reference*, std::size_t count, const char**) {
    return count == 0 ? OK : unit(c)->fail(ERROR, "there are no text variables");
}
FMI int fmi2SetInteger(void* c, const Reference*, std::size_t count, const int*) {
    return count == 0 ? OK : unit(c)->fail(ERROR, "no integer variable is an input");
}
FMI int fmi2SetBoolean(void* c, const Reference*, std::size_t count, const int*) {
    return count == 0 ? OK : unit(c)->fail(ERROR, "there are no Boolean variables");
}
FMI int fmi2SetString(void* c, const Reference*, std::size_t count, const char* const*) {
    return count == 0 ? OK : unit(c)->fail(ERROR, "there are no text variables");
}
FMI int fmi2GetDirectionalDerivative(void* c, const Reference*, std::size_t, const Reference*, std::size_t, const double*,
                                     double*) {
    return unit(c)->fail(ERROR, "it gives no directional derivatives");
}
FMI int fmi2SetRealInputDerivatives(void* c, const Reference*, std::size_t, const int*, const double*) {
    return unit(c)->fail(ERROR, "inputs are held over a step");
}
FMI int fmi2GetRealOutputDerivatives(void* c, const Reference*, std::size_t, const int*, double*) {
    return unit(c)->fail(ERROR, "it gives no derivatives of outputs");
}
FMI int fmi2CancelStep(void* c) { return unit(c)->fail(ERROR, "steps are not asynchronous"); }
FMI int fmi2GetStatus(void*, int, int* value) { return *value = OK, DISCARD; }
FMI int fmi2GetRealStatus(void* c, int, double* value) { return *value = rgcp_time(unit(c)->motion), OK; }
FMI int fmi2GetIntegerStatus(void*, int, int*) { return DISCARD; }
FMI int fmi2GetBooleanStatus(void*, int, int* value) { return *value = 0, OK; }
FMI int fmi2GetStringStatus(void*, int, const char** value) { return *value = "", OK; }
