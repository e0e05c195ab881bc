//! Small simulations that tests of several crates serve, step and disturb.
//!
//! [`Line`] and [`Trail`] have a fitness that depends on every actuator, seed and step; [`Walk`] fails where a test wants it
//! to; [`JointWalks`] steps all episodes of a batch by itself. Parties and networks stay with the crates that they test:
//! those of `pool` draw the order of messages, those of `schedules` model connections, retained messages and last wills.
#![allow(clippy::unwrap_used, clippy::panic)] // used by tests only

mod joint_walks;
mod line;
mod trail;
mod walk;

pub use joint_walks::JointWalks;
pub use line::{LINE_METRICS, Line};
pub use trail::{AGENTS, EXTREME_SPEED, Trail};
pub use walk::{WALK_METRICS, Walk};
