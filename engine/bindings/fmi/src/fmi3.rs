//! The functions of FMI 3.0 for co-simulation, in the order of chapters 2 and 4.

use std::ffi::{c_char, c_int, c_void};

use crate::fmi2::{
    deserialize, free_state, get_state, serialize, set_state, set_texts, state_bytes, texts,
};
use crate::instance::{Instance, State, Worth};
use crate::log::{Log, Logger3, Status};
use crate::model::Model;
use crate::shield::{free, handed_over, put, shield, to_fill, to_read};
use crate::text::text;
use crate::variables::Type;

type Component = *mut c_void;
type References = *const u32;

#[unsafe(no_mangle)]
extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Errors are always told, and nothing else is.
#[unsafe(no_mangle)]
extern "C" fn fmi3SetDebugLogging(
    _: Component,
    _: bool,
    _: usize,
    _: *const *const c_char,
) -> c_int {
    Status::Ok as c_int
}

#[unsafe(no_mangle)]
extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    event_mode: bool,
    _early_return: bool,
    _intermediate: References,
    _intermediate_count: usize,
    environment: *mut c_void,
    logger: Option<Logger3>,
    _update: *const c_void,
) -> Component {
    handed_over(|| {
        // SAFETY: texts are null or end with a null.
        let (token, resources) = unsafe { (text(token), text(resources)) };
        let log = logger.map_or(Log::None, |logger| Log::Three(logger, environment));
        if event_mode {
            log.tell(
                Status::Error,
                "this FMU has no event mode; instantiate it without",
            );
            return None;
        }
        match Model::read(std::path::Path::new(resources.as_deref().unwrap_or(""))) {
            Ok(model) => {
                let of = "instantiation token";
                Instance::new(log, model, token.as_deref().unwrap_or(""), of)
            }
            Err(reason) => {
                log.tell(Status::Error, &reason);
                None
            }
        }
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3InstantiateModelExchange(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: bool,
    _logging: bool,
    environment: *mut c_void,
    logger: Option<Logger3>,
) -> Component {
    refused(
        environment,
        logger,
        "this is an FMU for co-simulation, not for model exchange",
    )
}

#[unsafe(no_mangle)]
extern "C" fn fmi3InstantiateScheduledExecution(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: bool,
    _logging: bool,
    environment: *mut c_void,
    logger: Option<Logger3>,
    _update: *const c_void,
    _lock: *const c_void,
    _unlock: *const c_void,
) -> Component {
    refused(
        environment,
        logger,
        "this is an FMU for co-simulation, not for scheduled execution",
    )
}

fn refused(environment: *mut c_void, logger: Option<Logger3>, why: &str) -> Component {
    if let Some(logger) = logger {
        Log::Three(logger, environment).tell(Status::Error, why);
    }
    std::ptr::null_mut()
}

#[unsafe(no_mangle)]
extern "C" fn fmi3FreeInstance(c: Component) {
    free(c);
}

#[unsafe(no_mangle)]
extern "C" fn fmi3EnterInitializationMode(
    c: Component,
    _has_tolerance: bool,
    _tolerance: f64,
    start: f64,
    _has_stop: bool,
    _stop: f64,
) -> c_int {
    shield(c, |instance| {
        instance.set_start(start)?;
        instance.enter_initialization()
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3ExitInitializationMode(c: Component) -> c_int {
    shield(c, Instance::exit_initialization)
}

#[unsafe(no_mangle)]
extern "C" fn fmi3Terminate(c: Component) -> c_int {
    shield(c, |instance| {
        instance.terminate();
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3Reset(c: Component) -> c_int {
    shield(c, |instance| {
        instance.reset();
        Ok(())
    })
}

/// Functions to get and to set variables of a type; the second form is of types that no variable has.
macro_rules! variables {
    ($get:ident, $set:ident, $what:literal, $type:ty, $is:expr, $from:expr, $to:expr) => {
        #[unsafe(no_mangle)]
        extern "C" fn $get(
            c: Component,
            references: References,
            count: usize,
            values: *mut $type,
            value_count: usize,
        ) -> c_int {
            shield(c, |instance| {
                let (references, values) = to_fill(references, count, values, value_count)?;
                for (reference, value) in references.iter().zip(values) {
                    *value = match ($from)(instance.get(*reference, $is, $what)?) {
                        Some(found) => found,
                        None => return Err("a variable has a value of another type".into()),
                    };
                }
                Ok(())
            })
        }

        #[unsafe(no_mangle)]
        extern "C" fn $set(
            c: Component,
            references: References,
            count: usize,
            values: *const $type,
            value_count: usize,
        ) -> c_int {
            shield(c, |instance| {
                let (references, values) = to_read(references, count, values, value_count)?;
                for (reference, value) in references.iter().zip(values) {
                    instance.set(*reference, $is, $what, ($to)(*value))?;
                }
                Ok(())
            })
        }
    };
    ($($get:ident $set:ident $what:literal $type:ty),*) => {
        $(variables!(
            $get,
            $set,
            $what,
            $type,
            |_| false,
            |_| None::<$type>,
            |_| Worth::Flag(false)
        );)*
    };
}

variables!(
    fmi3GetFloat32,
    fmi3SetFloat32,
    "Float32",
    f32,
    |kind| kind == Type::Single,
    |worth| match worth {
        Worth::Number(number) => Some(number as f32),
        _ => None,
    },
    |value: f32| Worth::Number(value.into())
);
variables!(
    fmi3GetFloat64,
    fmi3SetFloat64,
    "Float64",
    f64,
    |kind| kind == Type::Double,
    |worth| match worth {
        Worth::Number(number) => Some(number),
        _ => None,
    },
    Worth::Number
);
variables!(
    fmi3GetInt64,
    fmi3SetInt64,
    "Int64",
    i64,
    |kind| kind == Type::Integer,
    |worth| match worth {
        Worth::Integer(value) => Some(value),
        _ => None,
    },
    Worth::Integer
);
variables!(
    fmi3GetUInt64,
    fmi3SetUInt64,
    "UInt64",
    u64,
    |kind| kind == Type::Seed,
    |worth| match worth {
        Worth::Seed(value) => Some(value),
        _ => None,
    },
    Worth::Seed
);
variables!(
    fmi3GetBoolean,
    fmi3SetBoolean,
    "Boolean",
    bool,
    |kind| kind == Type::Flag,
    |worth| match worth {
        Worth::Flag(flag) => Some(flag),
        _ => None,
    },
    Worth::Flag
);
variables!(
    fmi3GetInt8 fmi3SetInt8 "Int8" i8,
    fmi3GetUInt8 fmi3SetUInt8 "UInt8" u8,
    fmi3GetInt16 fmi3SetInt16 "Int16" i16,
    fmi3GetUInt16 fmi3SetUInt16 "UInt16" u16,
    fmi3GetInt32 fmi3SetInt32 "Int32" i32,
    fmi3GetUInt32 fmi3SetUInt32 "UInt32" u32
);

#[unsafe(no_mangle)]
extern "C" fn fmi3GetString(
    c: Component,
    references: References,
    count: usize,
    values: *mut *const c_char,
    value_count: usize,
) -> c_int {
    shield(c, |instance| {
        let (references, values) = to_fill(references, count, values, value_count)?;
        texts(instance, references, values)
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3SetString(
    c: Component,
    references: References,
    count: usize,
    values: *const *const c_char,
    value_count: usize,
) -> c_int {
    shield(c, |instance| {
        let (references, values) = to_read(references, count, values, value_count)?;
        set_texts(instance, references, values)
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3GetFMUState(c: Component, state: *mut *mut State) -> c_int {
    shield(c, |instance| get_state(instance, state))
}

#[unsafe(no_mangle)]
extern "C" fn fmi3SetFMUState(c: Component, state: *mut State) -> c_int {
    shield(c, |instance| set_state(instance, state))
}

#[unsafe(no_mangle)]
extern "C" fn fmi3FreeFMUState(_: Component, state: *mut *mut State) -> c_int {
    free_state(state)
}

#[unsafe(no_mangle)]
extern "C" fn fmi3SerializedFMUStateSize(
    c: Component,
    state: *mut State,
    size: *mut usize,
) -> c_int {
    shield(c, |instance| {
        let bytes = state_bytes(instance, state)?;
        // SAFETY: a place for a size, or null.
        unsafe { put(size, bytes.len()) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3SerializeFMUState(
    c: Component,
    state: *mut State,
    bytes: *mut u8,
    size: usize,
) -> c_int {
    shield(c, |instance| serialize(instance, state, bytes, size))
}

#[unsafe(no_mangle)]
extern "C" fn fmi3DeserializeFMUState(
    c: Component,
    bytes: *const u8,
    size: usize,
    state: *mut *mut State,
) -> c_int {
    shield(c, |instance| deserialize(instance, bytes, size, state))
}

#[unsafe(no_mangle)]
extern "C" fn fmi3DoStep(
    c: Component,
    time: f64,
    size: f64,
    _no_state_before: bool,
    event_needed: *mut bool,
    terminate: *mut bool,
    early_return: *mut bool,
    last_time: *mut f64,
) -> c_int {
    shield(c, |instance| {
        // SAFETY: places for values, or null.
        unsafe {
            put(event_needed, false);
            put(terminate, false);
            put(early_return, false);
        }
        let stepped = instance.advance(time, size);
        // SAFETY: a place for a number, or null.
        unsafe { put(last_time, instance.time()) };
        stepped
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi3UpdateDiscreteStates(
    c: Component,
    update: *mut bool,
    terminate: *mut bool,
    nominals: *mut bool,
    values: *mut bool,
    has_event: *mut bool,
    _event: *mut f64,
) -> c_int {
    shield(c, |_| {
        for target in [update, terminate, nominals, values, has_event] {
            // SAFETY: places for values, or null.
            unsafe { put(target, false) };
        }
        Ok(())
    })
}

/// There is nothing to do in these modes.
macro_rules! nothing_to_do {
    ($($name:ident),*) => {
        $(#[unsafe(no_mangle)]
        extern "C" fn $name(c: Component) -> c_int {
            shield(c, |_| Ok(()))
        })*
    };
}

nothing_to_do!(
    fmi3EnterEventMode,
    fmi3EnterStepMode,
    fmi3EnterConfigurationMode,
    fmi3ExitConfigurationMode,
    fmi3EvaluateDiscreteStates
);

/// There are none of these.
macro_rules! none {
    ($($name:ident),*) => {
        $(#[unsafe(no_mangle)]
        extern "C" fn $name(c: Component, count: *mut usize) -> c_int {
            shield(c, |_| {
                // SAFETY: a place for a number, or null.
                unsafe { put(count, 0) };
                Ok(())
            })
        })*
    };
}

none!(
    fmi3GetNumberOfEventIndicators,
    fmi3GetNumberOfContinuousStates
);

/// What modelDescription.xml does not announce; masters look for the functions all the same. What else these are called with
/// is left where it is: callers clear it away.
macro_rules! unsupported {
    ($($name:ident),*) => {
        $(#[unsafe(no_mangle)]
        extern "C" fn $name(c: Component) -> c_int {
            shield(c, |_| Err(concat!(stringify!($name), " is not supported").into()))
        })*
    };
}

unsupported!(
    fmi3GetBinary,
    fmi3SetBinary,
    fmi3GetClock,
    fmi3SetClock,
    fmi3GetNumberOfVariableDependencies,
    fmi3GetVariableDependencies,
    fmi3GetDirectionalDerivative,
    fmi3GetAdjointDerivative,
    fmi3GetOutputDerivatives,
    fmi3GetIntervalDecimal,
    fmi3GetIntervalFraction,
    fmi3GetShiftDecimal,
    fmi3GetShiftFraction,
    fmi3SetIntervalDecimal,
    fmi3SetIntervalFraction,
    fmi3SetShiftDecimal,
    fmi3SetShiftFraction,
    fmi3EnterContinuousTimeMode,
    fmi3CompletedIntegratorStep,
    fmi3SetTime,
    fmi3SetContinuousStates,
    fmi3GetContinuousStateDerivatives,
    fmi3GetEventIndicators,
    fmi3GetContinuousStates,
    fmi3GetNominalsOfContinuousStates,
    fmi3ActivateModelPartition
);
