//! What went wrong: a status for the caller, and words that wait in the thread until they are asked for.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::null;

use swarmwright_worlds::ParameterError;

use crate::input;

/// All went well.
pub(crate) const OK: i32 = 0;
/// What was given cannot be used.
pub(crate) const INVALID: i32 = 1;
/// What was asked for could not be done.
pub(crate) const FAILED: i32 = 2;

/// Why a call is refused or has failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// An argument that cannot be used, or a call that cannot be made now.
    Invalid(String),
    /// A parameter of an episode that cannot be used.
    Parameter(ParameterError),
    /// It was tried in vain.
    Failed(String),
}

impl Trouble {
    pub(crate) fn invalid(text: impl Into<String>) -> Self {
        Self::Invalid(text.into())
    }

    fn status(&self) -> i32 {
        match self {
            Self::Invalid(_) | Self::Parameter(_) => INVALID,
            Self::Failed(_) => FAILED,
        }
    }
}

impl From<ParameterError> for Trouble {
    fn from(error: ParameterError) -> Self {
        Self::Parameter(error)
    }
}

/// The last trouble, as C reads them.
#[derive(Default)]
struct LastError {
    text: CString,
    parameter: Option<CString>,
    reason: CString,
}

thread_local! {
    static LAST: RefCell<LastError> = RefCell::default();
}

/// Text for C, which ends at the first NUL: those inside become spaces.
pub(crate) fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

fn keep(trouble: &Trouble) {
    let error = match trouble {
        Trouble::Invalid(text) | Trouble::Failed(text) => LastError {
            text: c_text(text),
            parameter: None,
            reason: c_text(text),
        },
        Trouble::Parameter(error) => LastError {
            text: c_text(&error.to_string()),
            parameter: Some(c_text(&error.name)),
            reason: c_text(&error.reason),
        },
    };
    // A thread that is ending cannot store it any more, and will not ask for it.
    let _ = LAST.try_with(|last| last.replace(error));
}

/// Runs what stands behind a function of the ABI: errors are kept for the thread, panics become errors.
pub(crate) fn shield(call: impl FnOnce() -> Result<(), Trouble>) -> i32 {
    let result = catch_unwind(AssertUnwindSafe(call))
        .unwrap_or_else(|cause| Err(Trouble::Failed(panic_message(cause.as_ref()))));
    match result {
        Ok(()) => OK,
        Err(trouble) => {
            keep(&trouble);
            trouble.status()
        }
    }
}

/// As [`shield`], for functions that only give something back.
pub(crate) fn shield_or<T>(otherwise: T, call: impl FnOnce() -> Result<T, Trouble>) -> T {
    let mut value = otherwise;
    shield(|| {
        value = call()?;
        Ok(())
    });
    value
}

fn panic_message(cause: &(dyn Any + Send)) -> String {
    let text = cause
        .downcast_ref::<&str>()
        .map(ToString::to_string)
        .or_else(|| cause.downcast_ref::<String>().cloned());
    format!(
        "internal error in Swarmwright: {}",
        text.unwrap_or_else(|| "no reason given".to_owned())
    )
}

/// Forgets what was said, before a callback says something new.
pub(crate) fn forget() {
    let _ = LAST.try_with(RefCell::take);
}

/// What a callback said before it returned with a status other than [`OK`].
pub(crate) fn from_callback(status: i32, callback: &str) -> Trouble {
    let last = LAST.try_with(RefCell::take).unwrap_or_default();
    let plain = |text: &CString| text.to_string_lossy().into_owned();
    match (status, last.parameter) {
        (INVALID, Some(name)) => Trouble::Parameter(ParameterError {
            name: plain(&name),
            reason: plain(&last.reason),
        }),
        _ if last.text.is_empty() => Trouble::Failed(format!(
            "the simulation's function {callback} returned {status} without a reason"
        )),
        (INVALID, None) => Trouble::Invalid(plain(&last.text)),
        _ => Trouble::Failed(plain(&last.text)),
    }
}

/// Message of this thread's last failed call; valid until the next failed call.
#[unsafe(no_mangle)]
pub extern "C" fn swarmwright_error() -> *const c_char {
    shield_or(c"".as_ptr(), || {
        Ok(LAST
            .try_with(|last| last.borrow().text.as_ptr())
            .unwrap_or(c"".as_ptr()))
    })
}

/// The parameter that it was about, null if it was about none; valid as above.
#[unsafe(no_mangle)]
pub extern "C" fn swarmwright_error_parameter() -> *const c_char {
    shield_or(null(), || {
        let name = |last: &RefCell<LastError>| {
            let last = last.borrow();
            last.parameter.as_ref().map_or(null(), |name| name.as_ptr())
        };
        Ok(LAST.try_with(name).unwrap_or(null()))
    })
}

/// What is wrong with that parameter; valid as above.
#[unsafe(no_mangle)]
pub extern "C" fn swarmwright_error_reason() -> *const c_char {
    shield_or(c"".as_ptr(), || {
        Ok(LAST
            .try_with(|last| last.borrow().reason.as_ptr())
            .unwrap_or(c"".as_ptr()))
    })
}

/// For callbacks: says why they return with a status other than OK.
///
/// # Safety
/// `text` is null or ends with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_set_error(text: *const c_char) {
    // SAFETY: as the caller promises.
    let text = unsafe { input::lossy(text) };
    keep(&Trouble::Failed(text));
}

/// For callbacks: says which parameter cannot be used, and why.
///
/// # Safety
/// `parameter` and `reason` are null or end with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_set_parameter_error(
    parameter: *const c_char,
    reason: *const c_char,
) {
    // SAFETY: as the caller promises.
    let (name, reason) = unsafe { (input::lossy(parameter), input::lossy(reason)) };
    keep(&Trouble::Parameter(ParameterError { name, reason }));
}
