//! Work in progress on servers, by mode of evaluation.

pub(crate) mod batch;
pub(crate) mod episode;
pub(crate) mod in_flight;
pub(crate) mod request;

use std::time::Duration;

/// How long the supervisor of a server may take to report on it.
pub(crate) const REPORT_TIMEOUT: Duration = Duration::from_secs(20);
