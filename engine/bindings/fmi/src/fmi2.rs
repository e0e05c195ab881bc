//! The functions of FMI 2.0 for co-simulation, in the order of chapters 2 and 4.

use std::ffi::{CString, c_char, c_int, c_uint, c_void};

use crate::instance::{Instance, State, Worth};
use crate::log::{Log, Logger2, Status};
use crate::model::{Model, folder};
use crate::shield::{Refusal, free, handed_over, put, shield, slice, slice_mut, to_fill, to_read};
use crate::text::text;
use crate::variables::Type;

const CO_SIMULATION: c_int = 1;
const LAST_SUCCESSFUL_TIME: c_int = 2;
const TERMINATED: c_int = 3;

type Component = *mut c_void;
type References = *const c_uint;

/// `fmi2CallbackFunctions`, of which the functions for memory are not used.
#[repr(C)]
pub struct Callbacks {
    logger: Option<Logger2>,
    allocate: *const c_void,
    free: *const c_void,
    finished: *const c_void,
    environment: *mut c_void,
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Errors are always told, and nothing else is.
#[unsafe(no_mangle)]
extern "C" fn fmi2SetDebugLogging(
    _: Component,
    _: c_int,
    _: usize,
    _: *const *const c_char,
) -> c_int {
    Status::Ok as c_int
}

#[unsafe(no_mangle)]
extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    token: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> Component {
    handed_over(|| {
        // SAFETY: texts and callbacks are null or as the standard says, for the time of this call.
        let (name, token, resources, callbacks) =
            unsafe { (text(name), text(token), text(resources), callbacks.as_ref()) };
        let name = CString::new(name.as_deref().unwrap_or("")).unwrap_or_default();
        let log = callbacks
            .and_then(|all| {
                all.logger
                    .map(|logger| Log::Two(logger, all.environment, name))
            })
            .unwrap_or(Log::None);
        let model =
            folder(resources.as_deref().unwrap_or("")).and_then(|folder| Model::read(&folder));
        let problem = match (&model, kind) {
            (_, kind) if kind != CO_SIMULATION => {
                Some("this is an FMU for co-simulation, not for model exchange")
            }
            (Err(reason), _) => Some(reason.as_str()),
            _ => None,
        };
        if let Some(problem) = problem {
            log.tell(Status::Error, problem);
            return None;
        }
        Instance::new(log, model.ok()?, token.as_deref().unwrap_or(""), "GUID")
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2FreeInstance(c: Component) {
    free(c);
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetupExperiment(
    c: Component,
    _has_tolerance: c_int,
    _tolerance: f64,
    start: f64,
    _has_stop: c_int,
    _stop: f64,
) -> c_int {
    shield(c, |instance| instance.set_start(start))
}

#[unsafe(no_mangle)]
extern "C" fn fmi2EnterInitializationMode(c: Component) -> c_int {
    shield(c, Instance::enter_initialization)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2ExitInitializationMode(c: Component) -> c_int {
    shield(c, Instance::exit_initialization)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2Terminate(c: Component) -> c_int {
    shield(c, |instance| {
        instance.terminate();
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2Reset(c: Component) -> c_int {
    shield(c, |instance| {
        instance.reset();
        Ok(())
    })
}

/// Functions to get and to set variables of a type.
macro_rules! variables {
    ($get:ident, $set:ident, $what:literal, $type:ty, $is:expr, $from:expr, $to:expr) => {
        #[unsafe(no_mangle)]
        extern "C" fn $get(
            c: Component,
            references: References,
            count: usize,
            values: *mut $type,
        ) -> c_int {
            shield(c, |instance| {
                let (references, values) = to_fill(references, count, values, count)?;
                for (reference, value) in references.iter().zip(values) {
                    let found = instance.get(*reference, $is, $what)?;
                    *value = $from(found)?;
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
        ) -> c_int {
            shield(c, |instance| {
                let (references, values) = to_read(references, count, values, count)?;
                for (reference, value) in references.iter().zip(values) {
                    let kind = crate::variables::Variable::of(&instance.model, *reference)
                        .map(|variable| variable.kind(&instance.model));
                    let value = $to(*value, kind)?;
                    instance.set(*reference, $is, $what, value)?;
                }
                Ok(())
            })
        }
    };
}

fn unexpected<T>(_: Worth) -> Result<T, Refusal> {
    Err("a variable has a value of another type".into())
}

variables!(
    fmi2GetReal,
    fmi2SetReal,
    "Real",
    f64,
    |kind| matches!(kind, Type::Single | Type::Double),
    |worth| match worth {
        Worth::Number(number) => Ok(number),
        other => unexpected(other),
    },
    |value, _| Ok::<_, Refusal>(Worth::Number(value))
);
variables!(
    fmi2GetInteger,
    fmi2SetInteger,
    "Integer",
    c_int,
    |kind| matches!(kind, Type::Integer | Type::Seed),
    |worth| match worth {
        Worth::Integer(value) => Ok(c_int::try_from(value).unwrap_or(c_int::MAX)),
        Worth::Seed(value) => Ok(c_int::try_from(value).unwrap_or(c_int::MAX)),
        other => unexpected(other),
    },
    |value: c_int, kind| match (kind, u64::try_from(value)) {
        (Some(Type::Seed), Ok(seed)) => Ok(Worth::Seed(seed)),
        (Some(Type::Seed), Err(_)) => Err(Refusal::from(format!(
            "seed: {value} found, expected a whole number of at least 0"
        ))),
        _ => Ok(Worth::Integer(value.into())),
    }
);
variables!(
    fmi2GetBoolean,
    fmi2SetBoolean,
    "Boolean",
    c_int,
    |kind| kind == Type::Flag,
    |worth| match worth {
        Worth::Flag(flag) => Ok(c_int::from(flag)),
        other => unexpected(other),
    },
    |value, _| Ok::<_, Refusal>(Worth::Flag(value != 0))
);

#[unsafe(no_mangle)]
extern "C" fn fmi2GetString(
    c: Component,
    references: References,
    count: usize,
    values: *mut *const c_char,
) -> c_int {
    shield(c, |instance| {
        let (references, values) = to_fill(references, count, values, count)?;
        texts(instance, references, values)
    })
}

/// Texts of variables; they last until the next call.
pub fn texts(
    instance: &mut Instance,
    references: &[u32],
    values: &mut [*const c_char],
) -> Result<(), Refusal> {
    let mut strings = Vec::with_capacity(references.len());
    for reference in references {
        match instance.get(*reference, |kind| kind == Type::Text, "String")? {
            Worth::Text(text) => strings.push(CString::new(text).unwrap_or_default()),
            other => return unexpected(other),
        }
    }
    instance.texts = strings;
    for (text, value) in instance.texts.iter().zip(values) {
        *value = text.as_ptr();
    }
    Ok(())
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetString(
    c: Component,
    references: References,
    count: usize,
    values: *const *const c_char,
) -> c_int {
    shield(c, |instance| {
        let (references, values) = to_read(references, count, values, count)?;
        set_texts(instance, references, values)
    })
}

/// Sets variables that are texts.
pub fn set_texts(
    instance: &mut Instance,
    references: &[u32],
    values: &[*const c_char],
) -> Result<(), Refusal> {
    for (reference, value) in references.iter().zip(values) {
        // SAFETY: the master's texts end with a null.
        let value = unsafe { text(*value) }.unwrap_or_default().into_owned();
        let is = |kind| kind == Type::Text;
        instance.set(*reference, is, "String", Worth::Text(value))?;
    }
    Ok(())
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetFMUstate(c: Component, state: *mut *mut State) -> c_int {
    shield(c, |instance| get_state(instance, state))
}

/// Makes a copy of the state, in place of the one that is there.
pub fn get_state(instance: &mut Instance, state: *mut *mut State) -> Result<(), Refusal> {
    let copy = Box::into_raw(instance.state()?);
    // SAFETY: masters hand over the place of a pointer that is null or came from here.
    unsafe {
        let Some(target) = state.as_mut() else {
            drop(Box::from_raw(copy));
            return Err("the pointer to the state is null".into());
        };
        if !target.is_null() {
            drop(Box::from_raw(*target));
        }
        *target = copy;
    }
    Ok(())
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SetFMUstate(c: Component, state: *mut State) -> c_int {
    shield(c, |instance| set_state(instance, state))
}

pub fn set_state(instance: &mut Instance, state: *mut State) -> Result<(), Refusal> {
    // SAFETY: it came from `get_state`, or is null.
    let state = unsafe { state.as_ref() }.ok_or("the state to restore is missing")?;
    instance.set_state(state)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2FreeFMUstate(_: Component, state: *mut *mut State) -> c_int {
    free_state(state)
}

pub fn free_state(state: *mut *mut State) -> c_int {
    // SAFETY: masters hand over the place of a pointer that is null or came from `get_state`.
    unsafe {
        if let Some(target) = state.as_mut()
            && !target.is_null()
        {
            drop(Box::from_raw(*target));
            *target = std::ptr::null_mut();
        }
    }
    Status::Ok as c_int
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SerializedFMUstateSize(
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

pub fn state_bytes(instance: &Instance, state: *mut State) -> Result<Vec<u8>, Refusal> {
    // SAFETY: it came from `get_state`, or is null.
    unsafe { state.as_ref() }
        .ok_or("the state is missing")?
        .bytes(&instance.model.token)
}

#[unsafe(no_mangle)]
extern "C" fn fmi2SerializeFMUstate(
    c: Component,
    state: *mut State,
    bytes: *mut u8,
    size: usize,
) -> c_int {
    shield(c, |instance| serialize(instance, state, bytes, size))
}

pub fn serialize(
    instance: &Instance,
    state: *mut State,
    bytes: *mut u8,
    size: usize,
) -> Result<(), Refusal> {
    let state = state_bytes(instance, state)?;
    if state.len() > size {
        return Err(format!(
            "the state takes {} bytes, but the array has {size}",
            state.len()
        )
        .into());
    }
    // SAFETY: the array has `size` bytes.
    let target = unsafe { slice_mut(bytes, size)? };
    target[..state.len()].copy_from_slice(&state);
    target[state.len()..].fill(b' ');
    Ok(())
}

#[unsafe(no_mangle)]
extern "C" fn fmi2DeSerializeFMUstate(
    c: Component,
    bytes: *const u8,
    size: usize,
    state: *mut *mut State,
) -> c_int {
    shield(c, |instance| deserialize(instance, bytes, size, state))
}

pub fn deserialize(
    instance: &Instance,
    bytes: *const u8,
    size: usize,
    state: *mut *mut State,
) -> Result<(), Refusal> {
    // SAFETY: the array has `size` bytes.
    let copy = State::read(unsafe { slice(bytes, size)? }, &instance.model.token)?;
    free_state(state);
    // SAFETY: a place for a pointer, or null.
    let target = unsafe { state.as_mut() };
    *target.ok_or("the pointer to the state is null")? = Box::into_raw(copy);
    Ok(())
}

/// What modelDescription.xml does not announce; masters look for the functions all the same.
macro_rules! unsupported {
    ($name:ident, $text:literal, $($type:ty),*) => {
        #[unsafe(no_mangle)]
        extern "C" fn $name(c: Component, $(_: $type),*) -> c_int {
            shield(c, |_| Err($text.into()))
        }
    };
}

unsupported!(
    fmi2GetDirectionalDerivative,
    "this FMU has no derivatives",
    References,
    usize,
    References,
    usize,
    *const f64,
    *mut f64
);
unsupported!(
    fmi2SetRealInputDerivatives,
    "actuators are held during a step and have no derivatives",
    References,
    usize,
    *const c_int,
    *const f64
);
unsupported!(
    fmi2GetRealOutputDerivatives,
    "this FMU has no derivatives",
    References,
    usize,
    *const c_int,
    *mut f64
);
unsupported!(fmi2CancelStep, "no step is running",);
unsupported!(fmi2GetStatus, "no step is running", c_int, *mut c_int);
unsupported!(
    fmi2GetIntegerStatus,
    "this status does not exist",
    c_int,
    *mut c_int
);
unsupported!(
    fmi2GetStringStatus,
    "this status does not exist",
    c_int,
    *mut *const c_char
);

#[unsafe(no_mangle)]
extern "C" fn fmi2DoStep(c: Component, time: f64, size: f64, _no_state_before: c_int) -> c_int {
    shield(c, |instance| instance.advance(time, size))
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetRealStatus(c: Component, kind: c_int, value: *mut f64) -> c_int {
    shield(c, |instance| {
        if kind != LAST_SUCCESSFUL_TIME {
            return Err("this status does not exist".into());
        }
        // SAFETY: a place for a number, or null.
        unsafe { put(value, instance.time()) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
extern "C" fn fmi2GetBooleanStatus(c: Component, kind: c_int, value: *mut c_int) -> c_int {
    shield(c, |_| {
        if kind != TERMINATED {
            return Err("this status does not exist".into());
        }
        // SAFETY: a place for a number, or null.
        unsafe { put(value, 0) };
        Ok(())
    })
}
