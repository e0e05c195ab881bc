//! The optimization tool's side of the protocol: discovery, dispatch of episodes, results.
//!
//! [`scheduler`] makes the decisions and uses neither sockets nor clocks; [`Pool`] is a thin shell around it.

mod config;
mod counts;
mod demand;
mod journal;
mod metrics;
mod mode;
pub mod scheduler;
mod sections;
mod shell;
mod work;

pub use config::Config;
pub use counts::Counts;
pub use demand::Demand;
pub use journal::{Attempt, FailedEvaluation, Outcome, Warning};
pub use mode::Mode;
pub use scheduler::fleet::processes::{At, Ending};
pub use scheduler::queue::results::{Results, Settled, rectangle};
pub use scheduler::status::Holdings;
pub use scheduler::{Action, Scheduler};
pub use sections::{Faults, Timeouts};
pub use shell::error::PoolError;
pub use shell::options::{About, Options};
pub use shell::pool::Pool;
pub use shell::report::{Listener, Report};
pub use shell::scenes::{SceneEpisode, SceneError, SceneOptions};
pub use shell::supervision::{Place, Supervision};
pub use shell::watch::{News, Watcher, forget_servers, list_servers};
pub use work::{MakeGenomes, Repetition, Work, WorkError, check_shape, check_work};
