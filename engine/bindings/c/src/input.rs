//! What comes in by pointer, checked as far as that can be.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::ptr::copy_nonoverlapping;

use crate::error::Trouble;

/// A structure of the ABI that begins with its size, as its caller was compiled with it.
///
/// # Safety
/// It is `repr(C)`, its first field is a `usize`, and zero bytes are a value of every field.
pub(crate) unsafe trait Structure: Copy {
    /// Name of the type in C.
    const NAME: &'static str;
}

/// Reads a structure: what a caller of an older ABI does not know of is zero.
///
/// # Errors
/// Null, or more than this library knows of.
///
/// # Safety
/// `pointer` is null or points to as many bytes as its first field says.
pub(crate) unsafe fn structure<T: Structure>(pointer: *const T) -> Result<T, Trouble> {
    let name = T::NAME;
    if pointer.is_null() {
        return Err(Trouble::Invalid(format!(
            "{name}: must not be a null pointer"
        )));
    }
    // SAFETY: it begins with its size.
    let size = unsafe { pointer.cast::<usize>().read() };
    let most = size_of::<T>();
    if size < size_of::<usize>() || size > most {
        return Err(Trouble::Invalid(format!(
            "{name}: its size is {size}, expected at most {most}; set it to sizeof and include the header of this library's \
             version"
        )));
    }
    let mut value = MaybeUninit::<T>::zeroed();
    // SAFETY: there are as many bytes, they fit, and what is not written is zero.
    unsafe {
        copy_nonoverlapping(pointer.cast::<u8>(), value.as_mut_ptr().cast::<u8>(), size);
        Ok(value.assume_init())
    }
}

/// UTF-8 behind a pointer.
///
/// # Errors
/// Null, or not valid UTF-8; `label` names it.
///
/// # Safety
/// `pointer` is null or ends with NUL, and stays as long as the text is used.
pub(crate) unsafe fn text<'a>(label: &str, pointer: *const c_char) -> Result<&'a str, Trouble> {
    // SAFETY: as the caller promises.
    unsafe { optional(label, pointer)? }
        .ok_or_else(|| Trouble::Invalid(format!("{label}: must be a text, not a null pointer")))
}

/// As [`text`], none for null.
///
/// # Errors
/// No UTF-8.
///
/// # Safety
/// As [`text`].
pub(crate) unsafe fn optional<'a>(
    label: &str,
    pointer: *const c_char,
) -> Result<Option<&'a str>, Trouble> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: not null, so it ends with NUL.
    unsafe { CStr::from_ptr(pointer) }
        .to_str()
        .map(Some)
        .map_err(|_| Trouble::Invalid(format!("{label}: is not valid UTF-8")))
}

/// Text behind a pointer, whatever it is.
///
/// # Safety
/// `pointer` is null or ends with NUL.
pub(crate) unsafe fn lossy(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: not null, so it ends with NUL.
    unsafe { CStr::from_ptr(pointer) }
        .to_string_lossy()
        .into_owned()
}

/// Items behind a pointer, which may be null when there are none.
///
/// # Errors
/// Null, though there are some.
///
/// # Safety
/// `pointer` is null or points to `count` items, which stay and do not change as long as they are used.
pub(crate) unsafe fn items<'a, T>(
    label: &str,
    pointer: *const T,
    count: usize,
) -> Result<&'a [T], Trouble> {
    if count == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() {
        return Err(Trouble::Invalid(format!(
            "{label}: must not be a null pointer"
        )));
    }
    // SAFETY: not null, and as many as the caller promises.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// Writes to where the caller wants it.
///
/// # Errors
/// Null.
///
/// # Safety
/// `pointer` is null or may be written to.
pub(crate) unsafe fn write<T>(label: &str, pointer: *mut T, value: T) -> Result<(), Trouble> {
    if pointer.is_null() {
        return Err(Trouble::Invalid(format!(
            "{label}: must not be a null pointer"
        )));
    }
    // SAFETY: not null. What was there is overwritten unread, for it may be nothing.
    unsafe { pointer.write(value) };
    Ok(())
}

/// An object that this library gave out.
///
/// # Errors
/// Null.
///
/// # Safety
/// `pointer` is null or what the library gave out and did not take back.
pub(crate) unsafe fn object<'a, T>(label: &str, pointer: *const T) -> Result<&'a T, Trouble> {
    // SAFETY: as the caller promises.
    unsafe { pointer.as_ref() }
        .ok_or_else(|| Trouble::Invalid(format!("{label}: must not be a null pointer")))
}
