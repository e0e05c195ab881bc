//! Tracks a caller's live objects: a server is closed when the last one is dropped.

use std::cell::Cell;
use std::sync::{Condvar, Mutex, PoisonError};

/// Counter of live objects.
#[derive(Debug, Default)]
pub(crate) struct Live {
    count: Mutex<usize>,
    fewer: Condvar,
}

impl Live {
    pub(crate) fn add(&self) {
        *self.count.lock().unwrap_or_else(PoisonError::into_inner) += 1;
    }

    pub(crate) fn remove(&self) {
        *self.count.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        self.fewer.notify_all();
    }

    /// Waits until none is left: one that is evaluating elsewhere ends its episode first.
    pub(crate) fn wait_for_none(&self) {
        let mut count = self.count.lock().unwrap_or_else(PoisonError::into_inner);
        while *count > 0 {
            count = self
                .fewer
                .wait(count)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}

thread_local! {
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// Calls into the caller's code, and remembers that meanwhile.
pub(crate) fn inside<T>(call: impl FnOnce() -> T) -> T {
    let before = INSIDE.replace(true);
    let result = call();
    INSIDE.set(before);
    result
}

/// Whether this thread is inside a callback.
pub(crate) fn is_inside() -> bool {
    INSIDE.get()
}
