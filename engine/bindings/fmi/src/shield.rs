//! The border: from pointers to instances, and from results and panics to what FMI's functions return.

use std::ffi::{c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::instance::Instance;
use crate::log::Status;

/// Why a function did not do what it was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refusal {
    /// The step was not made, and nothing has changed.
    Discard(String),
    /// As the text says.
    Error(String),
}

impl From<String> for Refusal {
    fn from(text: String) -> Self {
        Self::Error(text)
    }
}

impl From<&str> for Refusal {
    fn from(text: &str) -> Self {
        Self::Error(text.to_owned())
    }
}

/// Calls with the instance that a pointer stands for; what goes wrong is told to the master.
pub fn shield(
    instance: *mut c_void,
    call: impl FnOnce(&mut Instance) -> Result<(), Refusal>,
) -> c_int {
    // SAFETY: masters hand over what fmi2Instantiate or fmi3InstantiateCoSimulation returned, from one thread at a time.
    let Some(instance) = (unsafe { instance.cast::<Instance>().as_mut() }) else {
        return Status::Error as c_int;
    };
    let called = catch_unwind(AssertUnwindSafe(|| call(instance)));
    let status = match called {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(Refusal::Discard(text))) => {
            instance.log.tell(Status::Discard, &text);
            Status::Discard
        }
        Ok(Err(Refusal::Error(text))) => {
            instance.log.tell(Status::Error, &text);
            Status::Error
        }
        Err(_) => {
            instance.log.tell(
                Status::Error,
                "internal error in Swarmwright; see the printed output",
            );
            Status::Error
        }
    };
    status as c_int
}

/// Turns a new instance into a pointer, null if there is none.
pub fn handed_over(make: impl FnOnce() -> Option<Box<Instance>>) -> *mut c_void {
    let instance = catch_unwind(AssertUnwindSafe(make)).ok().flatten();
    instance.map_or(std::ptr::null_mut(), |instance| {
        Box::into_raw(instance).cast()
    })
}

/// Frees what [`handed_over`] gave.
pub fn free(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: it came from `handed_over`, and masters do not use it afterwards.
        let instance = unsafe { Box::from_raw(instance.cast::<Instance>()) };
        // A panic while it ends must not cross the border to C, which has no way to return an error here.
        let _ = catch_unwind(AssertUnwindSafe(move || drop(instance)));
    }
}

/// Arrays that a master hands over.
///
/// # Safety
/// `start` has `count` values, or `count` is 0.
pub unsafe fn slice<'a, T>(start: *const T, count: usize) -> Result<&'a [T], Refusal> {
    if count == 0 {
        return Ok(&[]);
    }
    if start.is_null() {
        return Err("the pointer to an array is null".into());
    }
    // SAFETY: the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(start, count) })
}

/// As [`slice`], to be written.
///
/// # Safety
/// As of [`slice`].
pub unsafe fn slice_mut<'a, T>(start: *mut T, count: usize) -> Result<&'a mut [T], Refusal> {
    if count == 0 {
        return Ok(&mut []);
    }
    if start.is_null() {
        return Err("the pointer to an array is null".into());
    }
    // SAFETY: the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(start, count) })
}

/// The arrays of a call that reads variables.
pub fn to_fill<'a, T>(
    references: *const u32,
    count: usize,
    values: *mut T,
    value_count: usize,
) -> Result<(&'a [u32], &'a mut [T]), Refusal> {
    same(count, value_count)?;
    // SAFETY: masters hand over arrays of these sizes.
    Ok(unsafe { (slice(references, count)?, slice_mut(values, count)?) })
}

/// The arrays of a call that sets variables.
pub fn to_read<'a, T>(
    references: *const u32,
    count: usize,
    values: *const T,
    value_count: usize,
) -> Result<(&'a [u32], &'a [T]), Refusal> {
    same(count, value_count)?;
    // SAFETY: masters hand over arrays of these sizes.
    Ok(unsafe { (slice(references, count)?, slice(values, count)?) })
}

/// No variable is an array.
fn same(count: usize, value_count: usize) -> Result<(), Refusal> {
    if count == value_count {
        return Ok(());
    }
    Err(
        format!("{count} variables, but {value_count} values; no variable of this FMU is an array")
            .into(),
    )
}

/// Writes to a pointer unless it is null.
///
/// # Safety
/// It is null or points to a T.
pub unsafe fn put<T>(target: *mut T, value: T) {
    if !target.is_null() {
        // SAFETY: the caller's promise.
        unsafe { target.write(value) };
    }
}
