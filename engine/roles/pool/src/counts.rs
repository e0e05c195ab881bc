//! Counters of incidents.

use serde::Serialize;

/// Incidents since the pool was created.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Number of times that a server was lost, was silent for too long, or sent an unusable message.
    pub server_failures: u64,
    /// Number of these failures in which the server was silent for too long.
    pub time_outs: u64,
    /// Number of times that a server was paused because it had failed.
    pub benched: u64,
    /// Number of times that the connection to the broker broke.
    pub broker_losses: u64,
    /// Number of repeated attempts; they run on another server if there is one.
    pub retries: u64,
    /// Number of evaluations that have failed permanently.
    pub failed: u64,
    /// Number of these evaluations that are in quarantine because they crashed too many servers.
    pub quarantined: u64,
    /// Number of backup copies: work in progress that was also sent to another server because the first was slow or
    /// silent.
    pub backups: u64,
    /// Number of results that were refused because nothing waited for them any more.
    pub late: u64,
    /// Number of results that were refused because the evaluation already had one.
    pub double: u64,
    /// Number of messages that were refused because they named another simulation than their episode.
    pub foreign: u64,
    /// Number of evaluations that were repeated on another server to compare the results.
    pub audits: u64,
    /// Number of results that were accepted without the audit drawn for them because no other server could repeat them.
    pub audits_left_out: u64,
    /// Number of audits in which two servers disagreed.
    pub disagreements: u64,
    /// Number of evaluations that were repeated because their server had returned wrong results.
    pub recomputed: u64,
}
