/* The functions of FMI 3.0 for what these FMUs do not have: other types than Float64, clocks,
   structural parameters, event mode in co-simulation, scheduled execution. */

/* All variables are of type Float64: no reference of another type is known. */
#define NO_VARIABLES(name, type)                                                                \
  fmi3Status name(fmi3Instance instance, const fmi3ValueReference references[], size_t n,       \
                  type values[], size_t size) {                                                 \
    INSTANCE(name, TF_ANY);                                                                     \
    (void)values, (void)size;                                                                   \
    return n ? tf_fmi3(tf_unknown(c, #name, references[0])) : fmi3OK;                           \
  }
#define NONE_OF(type)                                                                           \
  NO_VARIABLES(fmi3Get##type, fmi3##type)                                                       \
  NO_VARIABLES(fmi3Set##type, const fmi3##type)
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

/* The same for functions that take other arguments after the references. */
#define NOTHING(name, ...)                                                                      \
  fmi3Status name(fmi3Instance instance, const fmi3ValueReference references[], size_t n,       \
                  __VA_ARGS__) {                                                                \
    INSTANCE(name, TF_ANY);                                                                     \
    return n ? tf_fmi3(tf_unknown(c, #name, references[0])) : fmi3OK;                           \
  }
NOTHING(fmi3GetBinary, size_t sizes[], fmi3Binary values[], size_t size)
NOTHING(fmi3SetBinary, const size_t sizes[], const fmi3Binary values[], size_t size)
NOTHING(fmi3GetClock, fmi3Clock values[])
NOTHING(fmi3SetClock, const fmi3Clock values[])
NOTHING(fmi3GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NOTHING(fmi3GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
        fmi3IntervalQualifier qualifiers[])
NOTHING(fmi3GetShiftDecimal, fmi3Float64 shifts[])
NOTHING(fmi3GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NOTHING(fmi3SetIntervalDecimal, const fmi3Float64 intervals[])
NOTHING(fmi3SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOTHING(fmi3SetShiftDecimal, const fmi3Float64 shifts[])
NOTHING(fmi3SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOTHING(fmi3GetOutputDerivatives, const fmi3Int32 orders[], fmi3Float64 values[], size_t size)

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference reference,
                                               size_t* n) {
  INSTANCE(fmi3GetNumberOfVariableDependencies, TF_ANY);
  (void)reference, (void)n;
  return tf_fmi3(tf_refuse(c, TF_ERROR, "dependencies per element are not offered"));
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elements[], fmi3ValueReference independents[],
                                       size_t of_independents[], fmi3DependencyKind kinds[],
                                       size_t n) {
  INSTANCE(fmi3GetVariableDependencies, TF_ANY);
  (void)dependent, (void)elements, (void)independents, (void)of_independents, (void)kinds, (void)n;
  return tf_fmi3(tf_refuse(c, TF_ERROR, "dependencies per element are not offered"));
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
  INSTANCE(fmi3EnterConfigurationMode, TF_ANY);
  return tf_fmi3(tf_refuse(c, TF_ERROR, "there are no structural parameters to configure"));
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
  INSTANCE(fmi3ExitConfigurationMode, TF_ANY);
  return tf_fmi3(tf_refuse(c, TF_ERROR, "there are no structural parameters to configure"));
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
  INSTANCE(fmi3EnterStepMode, TF_ANY);
  return tf_fmi3(tf_refuse(c, TF_ERROR, "there is no event mode in co-simulation to leave"));
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
  (void)resources, (void)visible, (void)update, (void)lock, (void)unlock;
  return tf_instantiate(name, token, 0, logging, environment, logger,
                        "cannot instantiate: this FMU offers no scheduled execution");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock,
                                      fmi3Float64 time) {
  INSTANCE(fmi3ActivateModelPartition, TF_ANY);
  (void)clock, (void)time;
  return tf_fmi3(tf_refuse(c, TF_ERROR, "this FMU offers no scheduled execution"));
}
