//! What happened beside results, in numbers.

use serde::Serialize;

/// Incidents since the pool began.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Times that a server was lost, fell silent for too long, or sent what cannot be used.
    pub server_failures: u64,
    /// Of these, those in which it was silent for too long.
    pub time_outs: u64,
    /// Times that a server had to pause because it failed.
    pub benched: u64,
    /// Times that the connection to the broker broke.
    pub broker_losses: u64,
    /// Attempts that were made again, on another server where there was one.
    pub retries: u64,
    /// Evaluations that have failed for good.
    pub failed: u64,
    /// Those of them that are in quarantine because they crashed too many servers.
    pub quarantined: u64,
    /// Copies of work in progress that were sent to another server because the first one was slow or silent.
    pub backups: u64,
    /// Results that came for something that was not waited for any more; they were refused.
    pub late: u64,
    /// Results for evaluations that had one already; they were refused.
    pub double: u64,
    /// Messages of an episode that named another simulation; they were refused.
    pub foreign: u64,
    /// Evaluations that were repeated on another server to see whether it finds the same.
    pub audits: u64,
    /// Results that count without the audit that was drawn, as no other server could repeat them.
    pub audits_left_out: u64,
    /// Of the audits, those in which two servers did not agree.
    pub disagreements: u64,
    /// Evaluations that were made again because their server turned out to be wrong.
    pub recomputed: u64,
}
