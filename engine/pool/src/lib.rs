//! The optimization tool's side of the protocol: discovery, dispatch of episodes, results.
//!
//! What is decided is in [`machine`], which knows neither sockets nor clocks; [`Pool`] is its thin shell.

mod audit;
mod batch;
mod config;
mod copies;
mod counts;
mod crowd;
mod demand;
mod discovery;
mod dispatch;
mod failures;
mod health;
mod holdings;
mod lag;
mod ledger;
mod limit;
mod limits;
pub mod machine;
mod metrics;
mod mode;
mod offers;
mod pace;
mod pool;
mod probe;
mod report;
mod requests;
mod run;
mod slot;
mod status;
mod stepwise;
mod supervision;
mod suspicion;
mod twins;
mod vouching;
mod watch;
mod work;

pub use config::{Config, Faults};
pub use counts::Counts;
pub use demand::Demand;
pub use holdings::Holdings;
pub use ledger::{Results, Settled, rectangle};
pub use machine::{Action, Machine};
pub use mode::Mode;
pub use offers::Offers;
pub use pool::{About, Options, Pool, PoolError};
pub use report::{Listener, Report};
pub use supervision::{At, Ending, Place, Supervision};
pub use watch::{News, Watcher, list_servers};
pub use work::{Attempt, Work, WorkError, check_work};
