/* Functions of FMI 3.0 for features that these FMUs do not have: other types than Float64, clocks,
   structural parameters, event mode in co-simulation, scheduled execution. */

#define NONE_OF(type)                                                                           \
  NO_VARIABLES(Get##type, fmi3##type values[], size_t size)                                     \
  NO_VARIABLES(Set##type, const fmi3##type values[], size_t size)
NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(Int32)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(Boolean)
NONE_OF(String)
NO_VARIABLES(GetBinary, size_t sizes[], fmi3Binary values[], size_t size)
NO_VARIABLES(SetBinary, const size_t sizes[], const fmi3Binary values[], size_t size)
NO_VARIABLES(GetClock, fmi3Clock values[])
NO_VARIABLES(SetClock, const fmi3Clock values[])
NO_VARIABLES(GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
             fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(GetShiftDecimal, fmi3Float64 shifts[])
NO_VARIABLES(GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NO_VARIABLES(SetIntervalDecimal, const fmi3Float64 intervals[])
NO_VARIABLES(SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NO_VARIABLES(SetShiftDecimal, const fmi3Float64 shifts[])
NO_VARIABLES(SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NO_VARIABLES(GetOutputDerivatives, const fmi3Int32 orders[], fmi3Float64 values[], size_t size)

REFUSED(GetNumberOfVariableDependencies,
        (fmi3Instance instance, fmi3ValueReference reference, size_t* n), TF_ERROR,
        "dependencies per element are not offered")
REFUSED(GetVariableDependencies,
        (fmi3Instance instance, fmi3ValueReference dependent, size_t elements[],
         fmi3ValueReference independents[], size_t of_independents[], fmi3DependencyKind kinds[],
         size_t n),
        TF_ERROR, "dependencies per element are not offered")
REFUSED(EnterConfigurationMode, (fmi3Instance instance), TF_ERROR,
        "there are no structural parameters to configure")
REFUSED(ExitConfigurationMode, (fmi3Instance instance), TF_ERROR,
        "there are no structural parameters to configure")
REFUSED(EnterStepMode, (fmi3Instance instance), TF_ERROR,
        "there is no event mode in co-simulation to leave")
REFUSED(ActivateModelPartition,
        (fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time), TF_ERROR,
        "this FMU offers no scheduled execution")

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
  return tf_instantiate(name, token, 0, logging, environment, (void*)logger,
                        "cannot instantiate: this FMU offers no scheduled execution");
}
