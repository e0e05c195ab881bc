//! How a simulation ends an episode that it cannot go on with.

use std::panic::resume_unwind;

/// Why a simulation gave up an episode; what unwinds from [`fail`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure(pub String);

/// Gives up the episode under way: for simulations whose `step`, `sense` or `fitness` can fail, such as those that only
/// pass on what other programs or languages say. It unwinds like a panic, without a panic's words on standard
/// error. Simulation wrappers catch it, report the reason to the optimization tool, and reset the simulation for the
/// next episode.
pub fn fail(reason: String) -> ! {
    resume_unwind(Box::new(Failure(reason)))
}
