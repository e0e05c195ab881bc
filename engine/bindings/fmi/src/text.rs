//! Texts that masters hand over.

use std::ffi::{CStr, c_char};

/// A text; none for a null pointer.
///
/// # Safety
/// It is null, or ends with a null.
pub unsafe fn text<'a>(start: *const c_char) -> Option<std::borrow::Cow<'a, str>> {
    if start.is_null() {
        return None;
    }
    // SAFETY: the caller's promise.
    Some(unsafe { CStr::from_ptr(start) }.to_string_lossy())
}
