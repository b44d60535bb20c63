// FMI 3.0 for co-simulation; see fmu_unit.h.
#include "public/fmu_unit.h"

namespace {

using fmu::of, fmu::Reference, fmu::Unit, fmu::OK, fmu::ERROR;
using Message = void (*)(void*, int, const char*, const char*);

int none(void* instance, std::size_t count) {
    return count == 0 ? OK : of(instance).fail(ERROR, "the unit has no variables of this type that this can be done with");
}
int refused(void* instance) { return of(instance).fail(ERROR, "the unit is one for co-simulation, without this"); }
void* nothing(void* environment, Message message) {
    if (message != nullptr) message(environment, ERROR, "error", "it is a unit for co-simulation");
    return nullptr;
}

}  // namespace

FMI const char* fmi3GetVersion() { return "3.0"; }
FMI int fmi3SetDebugLogging(void*, bool, std::size_t, const char* const*) { return OK; }

FMI void* fmi3InstantiateCoSimulation(const char*, const char*, const char* resources, bool, bool, bool, bool,
                                      const Reference*, std::size_t, void* environment, Message message, void*) {
    const auto log = [environment, message](int status, const char* what) {
        if (message != nullptr) message(environment, status, "error", what);
    };
    return Unit::made(resources == nullptr ? "" : resources, log);
}
FMI void* fmi3InstantiateModelExchange(const char*, const char*, const char*, bool, bool, void* environment, Message message) {
    return nothing(environment, message);
}
FMI void* fmi3InstantiateScheduledExecution(const char*, const char*, const char*, bool, bool, void* environment,
                                            Message message, void*, void*, void*) {
    return nothing(environment, message);
}
FMI void fmi3FreeInstance(void* i) { delete static_cast<Unit*>(i); }
FMI int fmi3EnterInitializationMode(void* i, bool, double, double start, bool, double) { return of(i).begin(start); }
FMI int fmi3ExitInitializationMode(void*) { return OK; }
FMI int fmi3EnterStepMode(void*) { return OK; }
FMI int fmi3Terminate(void*) { return OK; }
FMI int fmi3Reset(void* i) { return of(i).reset(); }

FMI int fmi3GetFloat64(void* i, const Reference* which, std::size_t count, double* values, std::size_t) {
    return of(i).get(which, count, values);
}
FMI int fmi3SetFloat64(void* i, const Reference* which, std::size_t count, const double* values, std::size_t) {
    return of(i).set(which, count, values);
}
FMI int fmi3GetInt32(void* i, const Reference* which, std::size_t count, std::int32_t* values, std::size_t) {
    return of(i).get(which, count, values);
}
FMI int fmi3DoStep(void* i, double, double size, bool, bool* event, bool* end, bool* early, double* reached) {
    const int status = of(i).step(size);
    *event = *end = *early = false, *reached = of(i).time();
    return status;
}

FMI int fmi3GetFMUState(void* i, void** state) { return of(i).take(state); }
FMI int fmi3SetFMUState(void* i, void* state) { return of(i).put(state); }
FMI int fmi3FreeFMUState(void*, void** state) { return Unit::release(state); }
FMI int fmi3SerializedFMUStateSize(void*, void* state, std::size_t* size) { return Unit::measure(state, size); }
FMI int fmi3SerializeFMUState(void* i, void* state, std::uint8_t* bytes, std::size_t size) {
    return of(i).write(state, bytes, size);
}
FMI int fmi3DeserializeFMUState(void* i, const std::uint8_t* bytes, std::size_t size, void** state) {
    return of(i).read(bytes, size, state);
}

// What the unit has none of; the standard has libraries export it all the same.
#define NO_VARIABLES(NAME, TYPE)                                                                               \
    FMI int fmi3Get##NAME(void* i, const Reference*, std::size_t n, TYPE*, std::size_t) { return none(i, n); } \
    FMI int fmi3Set##NAME(void* i, const Reference*, std::size_t n, TYPE const*, std::size_t) { return none(i, n); }
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, std::int8_t)
NO_VARIABLES(UInt8, std::uint8_t)
NO_VARIABLES(Int16, std::int16_t)
NO_VARIABLES(UInt16, std::uint16_t)
NO_VARIABLES(UInt32, std::uint32_t)
NO_VARIABLES(Int64, std::int64_t)
NO_VARIABLES(UInt64, std::uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, const char*)

using Count = std::size_t;
using Refs = const Reference*;
FMI int fmi3SetInt32(void* i, Refs, Count n, const std::int32_t*, Count) { return none(i, n); }
FMI int fmi3GetBinary(void* i, Refs, Count n, Count*, const std::uint8_t**, Count) { return none(i, n); }
FMI int fmi3SetBinary(void* i, Refs, Count n, const Count*, const std::uint8_t* const*, Count) { return none(i, n); }
FMI int fmi3GetClock(void* i, Refs, Count n, bool*) { return none(i, n); }
FMI int fmi3SetClock(void* i, Refs, Count n, const bool*) { return none(i, n); }
FMI int fmi3GetIntervalDecimal(void* i, Refs, Count n, double*, int*) { return none(i, n); }
FMI int fmi3GetIntervalFraction(void* i, Refs, Count n, std::uint64_t*, std::uint64_t*, int*) { return none(i, n); }
FMI int fmi3GetShiftDecimal(void* i, Refs, Count n, double*) { return none(i, n); }
FMI int fmi3GetShiftFraction(void* i, Refs, Count n, std::uint64_t*, std::uint64_t*) { return none(i, n); }
FMI int fmi3SetIntervalDecimal(void* i, Refs, Count n, const double*) { return none(i, n); }
FMI int fmi3SetIntervalFraction(void* i, Refs, Count n, const std::uint64_t*, const std::uint64_t*) { return none(i, n); }
FMI int fmi3SetShiftDecimal(void* i, Refs, Count n, const double*) { return none(i, n); }
FMI int fmi3SetShiftFraction(void* i, Refs, Count n, const std::uint64_t*, const std::uint64_t*) { return none(i, n); }
FMI int fmi3GetOutputDerivatives(void* i, Refs, Count n, const std::int32_t*, double*, Count) { return none(i, n); }
FMI int fmi3GetDirectionalDerivative(void* i, Refs, Count, Refs, Count, const double*, Count, double*, Count) {
    return refused(i);
}
FMI int fmi3GetAdjointDerivative(void* i, Refs, Count, Refs, Count, const double*, Count, double*, Count) { return refused(i); }
FMI int fmi3GetNumberOfVariableDependencies(void* i, Reference, Count*) { return refused(i); }
FMI int fmi3GetVariableDependencies(void* i, Reference, Count*, Reference*, Count*, int*, Count) { return refused(i); }
FMI int fmi3EnterEventMode(void* i) { return refused(i); }
FMI int fmi3EvaluateDiscreteStates(void* i) { return refused(i); }
FMI int fmi3UpdateDiscreteStates(void* i, bool*, bool*, bool*, bool*, bool*, double*) { return refused(i); }
FMI int fmi3EnterConfigurationMode(void* i) { return refused(i); }
FMI int fmi3ExitConfigurationMode(void* i) { return refused(i); }
FMI int fmi3EnterContinuousTimeMode(void* i) { return refused(i); }
FMI int fmi3CompletedIntegratorStep(void* i, bool, bool*, bool*) { return refused(i); }
FMI int fmi3SetTime(void* i, double) { return refused(i); }
FMI int fmi3SetContinuousStates(void* i, const double*, Count) { return refused(i); }
FMI int fmi3GetContinuousStates(void* i, double*, Count) { return refused(i); }
FMI int fmi3GetContinuousStateDerivatives(void* i, double*, Count) { return refused(i); }
FMI int fmi3GetNominalsOfContinuousStates(void* i, double*, Count) { return refused(i); }
FMI int fmi3GetEventIndicators(void* i, double*, Count) { return refused(i); }
FMI int fmi3GetNumberOfEventIndicators(void* i, Count*) { return refused(i); }
FMI int fmi3GetNumberOfContinuousStates(void* i, Count*) { return refused(i); }
FMI int fmi3ActivateModelPartition(void* i, Reference, double) { return refused(i); }
