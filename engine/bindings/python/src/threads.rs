//! The threads that share the engine's work.

use std::error::Error;
use std::sync::OnceLock;

use pyo3::PyResult;

use crate::errors::engine;

/// Starts the threads, one for each processor, unless they are there.
///
/// # Errors
/// The system refuses threads for lack of memory or by a limit. Without this call, `rayon` would panic at its first use.
pub fn start() -> PyResult<()> {
    static STARTED: OnceLock<Option<String>> = OnceLock::new();
    let failure = STARTED.get_or_init(|| {
        let error = rayon::ThreadPoolBuilder::new().build_global().err()?;
        // The other error means that they have been started already.
        error.source().map(ToString::to_string)
    });
    match failure {
        None => Ok(()),
        Some(reason) => Err(engine(format!(
            "could not start threads for the computation ({reason}): no memory or threads are left for this process; allow it \
             more (ulimit -v, ulimit -u, the memory limit of the job) or start fewer servers"
        ))),
    }
}
