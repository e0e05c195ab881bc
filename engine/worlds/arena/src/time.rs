//! Durations of episodes, ticks, and parts of ticks.

use super::math::random::MOST_TICKS;

/// Maximum length of an episode, seconds.
pub const LONGEST: f64 = (MOST_TICKS - 1) as f64 / 10.0;
/// Length of a tick, seconds.
pub const TICK: f32 = 0.1;
/// Number of substeps in a tick.
pub const SUBSTEPS: u32 = 10;
/// Length of a substep, seconds.
pub const SUBSTEP: f32 = 0.01;
/// Length of a part of a tick, in which contacts are solved, seconds.
pub const PART: f32 = 2.0 * SUBSTEP;
