//! How a server is to be run.

use std::env;
use std::ffi::{CString, c_char, c_void};
use std::time::Duration;

use swarmwright_mqtt::Settings;
use swarmwright_wrapper::{Notice, Options};

use crate::error::{Trouble, c_text};
use crate::input::{self, Structure};

/// Default address of the broker.
const BROKER: &str = "mqtt://localhost:1883";
/// Longest time that a caller can wait for, seconds: what a clock can add up without overflow.
const LONGEST: f64 = 1e9;

/// Is told what the operator should know.
type OnNotice = unsafe extern "C" fn(context: *mut c_void, kind: i32, text: *const c_char);

/// `swarmwright_options`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawOptions {
    size: usize,
    broker: *const c_char,
    id: u64,
    prefix: *const c_char,
    step_timeout: f64,
    threads: u32,
    notice: Option<OnNotice>,
    context: *mut c_void,
}

// SAFETY: as `Structure` asks.
unsafe impl Structure for RawOptions {
    const NAME: &'static str = "swarmwright_options";
}

/// Receiver of notices.
#[derive(Clone, Copy)]
pub(crate) struct Listener {
    call: Option<OnNotice>,
    context: *mut c_void,
}

// SAFETY: the header says that it is called on the thread that runs the server, whichever that is.
unsafe impl Send for Listener {}

/// Reads options.
///
/// # Errors
/// A broker that is not a URL, credentials that cannot be used, an id or a time that cannot be.
///
/// # Safety
/// `pointer` is null or points to options as the header describes them.
pub(crate) unsafe fn read(pointer: *const RawOptions) -> Result<(Options, Listener), Trouble> {
    // SAFETY: as the caller promises.
    let (raw, broker, prefix) = unsafe {
        let raw = input::structure(pointer)?;
        let broker = input::optional("swarmwright_options.broker", raw.broker)?;
        let prefix = input::optional("swarmwright_options.prefix", raw.prefix)?;
        (raw, broker, prefix)
    };
    let broker = given_or_of_environment(broker, "SWARMWRIGHT_BROKER", BROKER);
    if i64::try_from(raw.id).is_err() {
        return Err(Trouble::Invalid(format!(
            "the id is {}, expected a number from 0 to 2^63 - 1",
            raw.id
        )));
    }
    let step_timeout = seconds("the step time-out", raw.step_timeout)?;
    if step_timeout.is_zero() {
        return Err(Trouble::invalid(
            "the step time-out is 0 s; it must be more than 0",
        ));
    }
    let listener = Listener {
        call: raw.notice,
        context: raw.context,
    };
    let options = Options {
        progress: None,
        modules: Vec::new(),
        id: raw.id,
        settings: Settings::from_environment(&broker)
            .map_err(|error| Trouble::Invalid(error.to_string()))?,
        prefix: given_or_of_environment(prefix, "SWARMWRIGHT_PREFIX", ""),
        step_timeout,
        threads: raw.threads as usize,
        alone: false,
        on_frame: None,
    };
    Ok((options, listener))
}

/// What is given, else the value of a variable of the environment, else, also where that is empty, the default.
fn given_or_of_environment(option: Option<&str>, variable: &str, default: &str) -> String {
    option
        .map(str::to_owned)
        .or_else(|| env::var(variable).ok().filter(|value| !value.is_empty()))
        .unwrap_or_else(|| default.to_owned())
}

/// A time in seconds.
///
/// # Errors
/// Negative or no number.
pub(crate) fn seconds(label: &str, value: f64) -> Result<Duration, Trouble> {
    Duration::try_from_secs_f64(value.min(LONGEST))
        .ok()
        .filter(|_| !value.is_nan())
        .ok_or_else(|| {
            Trouble::Invalid(format!(
                "{label} is {value} s; expected a number of at least 0"
            ))
        })
}

impl Listener {
    pub(crate) fn tell(&self, notice: &Notice) {
        let Some(call) = self.call else { return };
        let kind = match notice {
            Notice::Ready => 0,
            Notice::Busy(_) => 1,
            Notice::Warning(_) => 2,
            Notice::Lost(_) => 3,
        };
        let text: CString = c_text(&notice.to_string());
        // SAFETY: the header has its signature, and it does not unwind.
        unsafe { call(self.context, kind, text.as_ptr()) };
    }
}
