//! Messages to the master.

use std::ffi::{CString, c_char, c_int, c_void};

/// What functions of FMI 2.0 and FMI 3.0 return, in both the same numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    Ok = 0,
    Warning = 1,
    Discard = 2,
    Error = 3,
}

/// `fmi2CallbackLogger`.
pub type Logger2 =
    unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...);
/// `fmi3LogMessageCallback`.
pub type Logger3 = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

/// Where messages go.
pub enum Log {
    None,
    Two(Logger2, *mut c_void, CString),
    Three(Logger3, *mut c_void),
}

impl Log {
    /// Says something.
    pub fn tell(&self, status: Status, text: &str) {
        let category = if status == Status::Discard {
            c"logStatusDiscard"
        } else if status == Status::Warning {
            c"logStatusWarning"
        } else {
            c"logStatusError"
        };
        let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
        match self {
            Self::None => {}
            Self::Two(logger, environment, name) => {
                // SAFETY: the master's function, with its environment; the format has one text.
                unsafe {
                    logger(
                        *environment,
                        name.as_ptr(),
                        status as c_int,
                        category.as_ptr(),
                        c"%s".as_ptr(),
                        text.as_ptr(),
                    );
                }
            }
            Self::Three(logger, environment) => {
                // SAFETY: the master's function, with its environment.
                unsafe {
                    logger(
                        *environment,
                        status as c_int,
                        category.as_ptr(),
                        text.as_ptr(),
                    )
                };
            }
        }
    }
}
