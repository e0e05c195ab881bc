//! How a simulation ends an episode that it cannot go on with.

use std::fmt;
use std::panic::resume_unwind;

/// Why a simulation gave up an episode; what unwinds from [`fail`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// What went wrong and, where known, in which line.
    pub reason: String,
    /// Where in the simulation's code, in the words of its language, such as a Python traceback.
    pub stack: Option<String>,
}

impl From<String> for Failure {
    fn from(reason: String) -> Self {
        Self {
            reason,
            stack: None,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str(&self.reason)
    }
}

/// Gives up the episode under way: for simulations whose `step`, `sense` or `fitness` can fail, such as those that only
/// pass on what other programs or languages say. It unwinds like a panic, without a panic's words on standard
/// error. Simulation wrappers catch it, report it to the optimization tool, and reset the simulation for the
/// next episode. `why`: a reason, or a [`Failure`] with a stack.
pub fn fail(why: impl Into<Failure>) -> ! {
    resume_unwind(Box::new(why.into()))
}
