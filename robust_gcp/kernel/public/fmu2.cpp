// FMI 2.0 for co-simulation; see fmu_unit.h.
#include <cstdlib>

#include "public/fmu_unit.h"

namespace {

using fmu::of, fmu::Reference, fmu::Unit, fmu::OK, fmu::DISCARD, fmu::ERROR;

// As the standard has them.
using Logger = void (*)(void*, const char*, int, const char*, const char*, ...);
struct Callbacks {
    Logger logger;
    void* (*allocate)(std::size_t, std::size_t);
    void (*release)(void*);
    void (*finished)(void*, int);
    void* environment;
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

int none(void* component, std::size_t count, const char* what) { return count == 0 ? OK : of(component).fail(ERROR, what); }

}  // namespace

FMI const char* fmi2GetTypesPlatform() { return "default"; }
FMI const char* fmi2GetVersion() { return "2.0"; }
FMI int fmi2SetDebugLogging(void*, int, std::size_t, const char* const*) { return OK; }

FMI void* fmi2Instantiate(const char* name, int type, const char*, const char* resources, const Callbacks* callbacks, int,
                          int) {
    try {
        const std::string own = name == nullptr ? "" : name;
        const auto log = [own, callbacks](int status, const char* what) {
            if (callbacks != nullptr && callbacks->logger != nullptr)
                callbacks->logger(callbacks->environment, own.c_str(), status, "error", "%s", what);
        };
        if (type != 1) return log(ERROR, "it is a unit for co-simulation"), nullptr;
        return Unit::made(folder(resources), log);
    } catch (const std::exception&) {
        return nullptr;
    }
}
FMI void fmi2FreeInstance(void* component) { delete static_cast<Unit*>(component); }
FMI int fmi2SetupExperiment(void* component, int, double, double start, int, double) {
    of(component).start = start;
    return OK;
}
FMI int fmi2EnterInitializationMode(void* component) { return of(component).begin(of(component).start); }
FMI int fmi2ExitInitializationMode(void*) { return OK; }
FMI int fmi2Terminate(void*) { return OK; }
FMI int fmi2Reset(void* component) { return of(component).reset(); }

FMI int fmi2GetReal(void* c, const Reference* which, std::size_t count, double* values) {
    return of(c).get(which, count, values);
}
FMI int fmi2GetInteger(void* c, const Reference* which, std::size_t count, int* values) {
    return of(c).get(which, count, values);
}
FMI int fmi2SetReal(void* c, const Reference* which, std::size_t count, const double* values) {
    return of(c).set(which, count, values);
}
FMI int fmi2DoStep(void* c, double, double size, int) { return of(c).step(size); }

FMI int fmi2GetFMUstate(void* c, void** state) { return of(c).take(state); }
FMI int fmi2SetFMUstate(void* c, void* state) { return of(c).put(state); }
FMI int fmi2FreeFMUstate(void*, void** state) { return Unit::release(state); }
FMI int fmi2SerializedFMUstateSize(void*, void* state, std::size_t* size) { return Unit::measure(state, size); }
FMI int fmi2SerializeFMUstate(void* c, void* state, char* bytes, std::size_t size) { return of(c).write(state, bytes, size); }
FMI int fmi2DeSerializeFMUstate(void* c, const char* bytes, std::size_t size, void** state) {
    return of(c).read(bytes, size, state);
}

// What the unit has none of.
FMI int fmi2GetBoolean(void* c, const Reference*, std::size_t count, int*) {
    return none(c, count, "there are no Boolean variables");
}
FMI int fmi2GetString(void* c, const Reference*, std::size_t count, const char**) {
    return none(c, count, "there are no text variables");
}
FMI int fmi2SetInteger(void* c, const Reference*, std::size_t count, const int*) {
    return none(c, count, "no integer variable is an input");
}
FMI int fmi2SetBoolean(void* c, const Reference*, std::size_t count, const int*) {
    return none(c, count, "there are no Boolean variables");
}
FMI int fmi2SetString(void* c, const Reference*, std::size_t count, const char* const*) {
    return none(c, count, "there are no text variables");
}
FMI int fmi2GetDirectionalDerivative(void* c, const Reference*, std::size_t, const Reference*, std::size_t, const double*,
                                     double*) {
    return of(c).fail(ERROR, "it gives no directional derivatives");
}
FMI int fmi2SetRealInputDerivatives(void* c, const Reference*, std::size_t, const int*, const double*) {
    return of(c).fail(ERROR, "inputs are held over a step");
}
FMI int fmi2GetRealOutputDerivatives(void* c, const Reference*, std::size_t, const int*, double*) {
    return of(c).fail(ERROR, "it gives no derivatives of outputs");
}
FMI int fmi2CancelStep(void* c) { return of(c).fail(ERROR, "steps are not asynchronous"); }
FMI int fmi2GetStatus(void*, int, int* value) { return *value = OK, DISCARD; }
FMI int fmi2GetRealStatus(void* c, int, double* value) { return *value = of(c).time(), OK; }
FMI int fmi2GetIntegerStatus(void*, int, int*) { return DISCARD; }
FMI int fmi2GetBooleanStatus(void*, int, int* value) { return *value = 0, OK; }
FMI int fmi2GetStringStatus(void*, int, const char** value) { return *value = "", OK; }
