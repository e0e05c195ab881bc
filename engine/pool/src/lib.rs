//! The optimization tool's side of the protocol: discovery, dispatch of episodes, results.
//!
//! What is decided is in [`machine`], which knows neither sockets nor clocks; [`Pool`] is its thin shell.

pub mod machine;
mod offers;
mod pool;
mod run;
mod task;

pub use machine::{Action, Config, Machine};
pub use offers::{Demand, Offers};
pub use pool::{Options, Pool, PoolError, list_servers};
pub use task::{Attempt, Outcome, Task};
