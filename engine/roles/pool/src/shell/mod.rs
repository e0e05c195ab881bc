//! Input and output: the connection, threads, and the clock.

pub(crate) mod error;
pub(crate) mod load;
pub(crate) mod options;
pub(crate) mod outages;
pub(crate) mod pool;
pub(crate) mod probe;
pub(crate) mod report;
pub(crate) mod scenes;
pub(crate) mod supervision;
pub(crate) mod wall;
pub(crate) mod watch;
