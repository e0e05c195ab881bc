//! Deterministic simulation testing of pools and servers: seeded schedules of faults, in virtual time.
//!
//! The state machines of [`swarmwright_pool`] and [`swarmwright_wrapper`] know neither sockets nor clocks. Here they are run
//! with a simulated network, broker and clock: from one number, the seed, a [`Schedule`] is drawn that says who takes part
//! and which faults are injected when. These properties must hold whatever happens (see
//! `docs/explanation/faults.md`):
//! every candidate is scored exactly once, with the bits of an undisturbed evaluation, or is reported failed where the
//! schedule explains it; no work waits for ever; no server idles while work waits for it; nothing grows without bound;
//! and in the end all servers are free and say so.
//!
//! A schedule that breaks one is made as small as it can be and printed, with the command that repeats it.

mod client;
mod draw;
mod faults;

mod network;
mod random;
pub mod scale;
mod schedule;
mod server;
mod shrink;
mod simulator;
mod survey;
mod tool;
mod trail;

pub use draw::draw;
pub use schedule::{Disturbance, Kind, Memory, Schedule, Server, Time, Tool, What, Who, Work};
pub use shrink::shrink;
pub use simulator::properties::IDLE;
pub use simulator::{RECOVERY, Report};
pub use survey::{Survey, survey, tell};

/// Runs a schedule; a panic of a machine is a violation, too. `log`: whether what happens is to be written down.
#[must_use]
pub fn check(schedule: &Schedule, log: bool) -> Report {
    std::panic::catch_unwind(|| simulator::run(schedule, log)).unwrap_or_else(|cause| {
        let text = cause.downcast_ref::<String>().cloned();
        let text = text.or_else(|| cause.downcast_ref::<&str>().map(ToString::to_string));
        Report {
            violation: Some(format!("a machine panicked: {}", text.unwrap_or_default())),
            events: 0,
            end: 0,
            fingerprint: 0,
            scored: 0,
            failed: 0,
            ended: 0,
            log: Vec::new(),
        }
    })
}
