//! The parameters of an episode, read with type and range as built-in simulations read theirs.

use std::cell::{OnceCell, RefCell};
use std::ffi::{CString, c_char};
use std::ptr::null;

use serde_json::Value;
use swarmwright_worlds::{ParameterReader, Parameters};

use crate::error::{Trouble, c_text, shield, shield_or};
use crate::input;

/// `swarmwright_parameters`: what a simulation is reset with.
pub struct ParameterHandle<'a> {
    parameters: &'a Parameters,
    json: OnceCell<CString>,
    /// Lists that were given out, which stay as long as this does.
    numbers: RefCell<Vec<Box<[f64]>>>,
    positions: RefCell<Vec<Box<[[f32; 2]]>>>,
}

impl<'a> ParameterHandle<'a> {
    pub(crate) fn new(parameters: &'a Parameters) -> Self {
        Self {
            parameters,
            json: OnceCell::new(),
            numbers: RefCell::default(),
            positions: RefCell::default(),
        }
    }

    fn json(&self) -> &CString {
        self.json
            .get_or_init(|| c_text(&Value::Object(self.parameters.clone()).to_string()))
    }
}

/// Reads a parameter and writes it; what is absent stays as it is.
///
/// # Safety
/// As `input::object`, `input::text` and `input::write` ask of `handle`, `name` and `value`.
unsafe fn read<T>(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    value: *mut T,
    find: impl FnOnce(&ParameterHandle<'_>, ParameterReader<'_>, &str) -> Result<Option<T>, Trouble>,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (handle, name) = unsafe {
            (
                input::object("the parameters", handle)?,
                input::text("the name of a parameter", name)?,
            )
        };
        match find(handle, ParameterReader::new(handle.parameters), name)? {
            // SAFETY: as the caller promises.
            Some(parameter) => unsafe { input::write(name, value, parameter) },
            None => Ok(()),
        }
    })
}

/// Reads parameters from a JSON object, for tests of a simulation; to be given to `swarmwright_parameters_free`.
///
/// # Safety
/// `json` is null or ends with NUL, `handle` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameters_new(
    json: *const c_char,
    handle: *mut *mut ParameterHandle<'static>,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let text = unsafe { input::text("the parameters", json)? };
        let parameters: Parameters = serde_json::from_str(text).map_err(|error| {
            Trouble::Invalid(format!("the parameters are not a JSON object: {error}"))
        })?;
        // Leaked here, taken back when it is freed.
        let parameters: &'static Parameters = Box::leak(Box::new(parameters));
        let new = Box::into_raw(Box::new(ParameterHandle::new(parameters)));
        // SAFETY: as the caller promises.
        unsafe { input::write("the pointer for the parameters", handle, new) }
    })
}

/// Frees what `swarmwright_parameters_new` made; null is nothing to do.
///
/// # Safety
/// `handle` is null or what that function gave, once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameters_free(handle: *mut ParameterHandle<'static>) {
    shield(|| {
        if !handle.is_null() {
            // SAFETY: both were leaked by the function above, and they are not used any more.
            unsafe {
                let handle = Box::from_raw(handle);
                let parameters: *const Parameters = handle.parameters;
                drop(handle);
                drop(Box::from_raw(parameters.cast_mut()));
            }
        }
        Ok(())
    });
}

/// The parameters as a JSON object, for what the functions below do not read.
///
/// # Safety
/// `handle` is null or the parameters that a callback has.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameters_json(
    handle: *const ParameterHandle<'_>,
) -> *const c_char {
    shield_or(null(), || {
        // SAFETY: as the caller promises.
        let handle = unsafe { input::object("the parameters", handle)? };
        Ok(handle.json().as_ptr())
    })
}

/// Whether the experiment sets a parameter.
///
/// # Safety
/// `handle` as above, `name` is null or ends with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_given(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
) -> bool {
    shield_or(false, || {
        // SAFETY: as the caller promises.
        let (handle, name) = unsafe {
            (
                input::object("the parameters", handle)?,
                input::text("the name of a parameter", name)?,
            )
        };
        Ok(handle.parameters.contains_key(name))
    })
}

/// A whole number in `low..=high`.
///
/// # Safety
/// `handle` and `name` as above, `value` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_integer(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    low: i64,
    high: i64,
    value: *mut i64,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, value, |_, from, name| {
            Ok(from.whole(name, low, high)?)
        })
    }
}

/// A finite number in `low..=high`; an infinite bound is none.
///
/// # Safety
/// As `swarmwright_parameter_integer`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_number(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    low: f64,
    high: f64,
    value: *mut f64,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, value, |_, from, name| {
            Ok(from.number(name, low, high)?)
        })
    }
}

/// A finite number in `low..=high`, rounded to binary32 before it is compared; an infinite bound is none.
///
/// # Safety
/// As `swarmwright_parameter_integer`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_single(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    low: f32,
    high: f32,
    value: *mut f32,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, value, |_, from, name| {
            Ok(from.single(name, low, high)?)
        })
    }
}

/// True or false.
///
/// # Safety
/// As `swarmwright_parameter_integer`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_flag(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    value: *mut bool,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe { read(handle, name, value, |_, from, name| Ok(from.flag(name)?)) }
}

/// A seed: any whole number of 64 bits; a negative one stands for its two's complement.
///
/// # Safety
/// As `swarmwright_parameter_integer`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_seed(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    value: *mut u64,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe { read(handle, name, value, |_, from, name| Ok(from.seed(name)?)) }
}

/// A text, UTF-8 without a NUL behind it; it stays as long as the parameters do.
///
/// # Safety
/// As `swarmwright_parameter_integer`, for `text` and `length`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_text(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    text: *mut *const c_char,
    length: *mut usize,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, text, |_, from, name| {
            let Some(string) = from.text(name)? else {
                return Ok(None);
            };
            input::write(name, length, string.len())?;
            Ok(Some(string.as_ptr().cast()))
        })
    }
}

/// One of several texts, as its index.
///
/// # Safety
/// As `swarmwright_parameter_integer`; `choices` are `count` texts that end with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_choice(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    choices: *const *const c_char,
    count: usize,
    index: *mut usize,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, index, |_, from, name| {
            let choices = input::items(name, choices, count)?;
            let texts: Vec<&str> = choices
                .iter()
                .map(|choice| input::text(name, *choice))
                .collect::<Result<_, _>>()?;
            Ok(from.choice(name, &texts)?)
        })
    }
}

/// A list of `least..=most` finite numbers, each in `low..=high`; it stays as long as the parameters do.
///
/// # Safety
/// As `swarmwright_parameter_integer`, for `values` and `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_numbers(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    least: usize,
    most: usize,
    low: f64,
    high: f64,
    values: *mut *const f64,
    count: *mut usize,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, values, |handle, from, name| {
            let Some(list) = from.numbers(name, least..=most, low, high)? else {
                return Ok(None);
            };
            input::write(name, count, list.len())?;
            let boxed = list.into_boxed_slice();
            let first = boxed.as_ptr();
            handle.numbers.borrow_mut().push(boxed);
            Ok(Some(first))
        })
    }
}

/// A position in 0..=width and 0..=height, rounded to binary32.
///
/// # Safety
/// As `swarmwright_parameter_integer`; `position` points to two numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_position(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    width: f32,
    height: f32,
    position: *mut f32,
) -> i32 {
    let target: *mut [f32; 2] = position.cast();
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, target, |_, from, name| {
            Ok(from.position(name, [width, height])?)
        })
    }
}

/// At most `most` positions, x and y of one after another; they stay as long as the parameters do.
///
/// # Safety
/// As `swarmwright_parameter_integer`, for `positions` and `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_parameter_positions(
    handle: *const ParameterHandle<'_>,
    name: *const c_char,
    most: u32,
    width: f32,
    height: f32,
    positions: *mut *const f32,
    count: *mut usize,
) -> i32 {
    // SAFETY: as the caller promises.
    unsafe {
        read(handle, name, positions, |handle, from, name| {
            let Some(list) = from.positions(name, most, [width, height])? else {
                return Ok(None);
            };
            input::write(name, count, list.len())?;
            let boxed = list.into_boxed_slice();
            let first = boxed.as_ptr().cast();
            handle.positions.borrow_mut().push(boxed);
            Ok(Some(first))
        })
    }
}
