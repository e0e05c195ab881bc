//! Journal of attempts, one line per attempt.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use serde::Serialize;

/// How an attempt ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The attempt returned results.
    #[default]
    Done,
    /// The simulation failed during the evaluation.
    Failed,
    /// The evaluation cannot be requested, or its results cannot be used.
    Unusable,
    /// The server failed on this work: it went down, was silent for too long, or is not used any more.
    ServerFailed,
    /// The server held this work when it failed on other work, or was stopped.
    Lost,
    /// The connection to the broker broke.
    Disconnected,
    /// The server handed the work back: it serves another tool, for the moment or always.
    HandedBack,
    /// Another server with the same work was faster.
    Overtaken,
    /// The evaluation was given up in the meantime, so the result was no longer needed.
    Dropped,
}

/// One line of the journal: one attempt at an episode or at a block of episodes.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Attempt {
    /// Mode: stepwise, batched or offloaded.
    pub mode: &'static str,
    /// Index of the first candidate.
    pub candidate: usize,
    /// Number of candidates.
    pub candidates: usize,
    /// Index of the first episode.
    pub episode: usize,
    /// Number of episodes per candidate.
    pub episodes: usize,
    /// Id of the server.
    pub server: u64,
    /// Number of the attempt, from 1.
    pub attempt: u32,
    /// Number of steps that the server took, in stepwise mode.
    pub steps: Option<u64>,
    /// Start, in seconds since 1970.
    pub started: f64,
    /// Duration in seconds.
    pub seconds: f64,
    /// Outcome of the attempt.
    pub outcome: Outcome,
    /// Why the attempt returned no results; `None` if it did.
    pub error: Option<String>,
    /// Place in the simulation's code, if known; given once per reason.
    pub stack: Option<String>,
}

/// A warning for the user.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Warning {
    /// Text of the warning.
    pub text: String,
    /// Time of the warning, in seconds since 1970.
    pub time: f64,
    /// The evaluation that failed permanently, if the warning is about one.
    pub failed: Option<FailedEvaluation>,
    /// Whether the warning is about results accepted without audits.
    pub unaudited: bool,
}

impl Warning {
    /// Creates a warning with the current time.
    pub(crate) fn now(text: String) -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            text,
            time: since_1970.unwrap_or_default().as_secs_f64(),
            ..Self::default()
        }
    }
}

/// An evaluation that has failed permanently.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FailedEvaluation {
    /// Index of the candidate.
    pub candidate: usize,
    /// Index of the episode.
    pub episode: usize,
    /// Number of servers that failed on the evaluation if it is in quarantine; `None` if the evaluation itself failed.
    pub quarantined: Option<u32>,
}

/// Attempts that have not been taken yet, each with its start.
#[derive(Debug, Default)]
pub(crate) struct Journal {
    attempts: Vec<(Attempt, Instant)>,
}

impl Journal {
    pub fn push(&mut self, attempt: Attempt, started: Instant) {
        self.attempts.push((attempt, started));
    }

    pub fn len(&self) -> usize {
        self.attempts.len()
    }

    /// Returns all but the first `count` attempts.
    pub fn after(&self, count: usize) -> &[(Attempt, Instant)] {
        self.attempts.get(count..).unwrap_or_default()
    }

    /// Takes the attempts made since the last call.
    pub fn take(&mut self) -> Vec<(Attempt, Instant)> {
        std::mem::take(&mut self.attempts)
    }
}
