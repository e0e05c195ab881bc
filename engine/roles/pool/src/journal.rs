//! The journal of what was done: a line per attempt.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use serde::Serialize;

/// How an attempt ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// With results.
    #[default]
    Done,
    /// The simulation failed in the evaluation.
    Failed,
    /// The evaluation cannot be asked for, or its results cannot be used.
    Unusable,
    /// The server failed while it was at this: it went down, was silent for too long, or is not used any more.
    ServerFailed,
    /// The server had this when it failed at something else, or was ended.
    Lost,
    /// The connection to the broker broke.
    Disconnected,
    /// The server handed it back: it is for another tool, now or as a rule.
    HandedBack,
    /// Another server that had the same work was faster.
    Overtaken,
    /// The evaluation was given up meanwhile, so that nothing depended on this any more.
    Dropped,
}

/// A line of the journal: one attempt at one episode, or at a block of them.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Attempt {
    /// How: stepwise, batched, offloaded.
    pub mode: &'static str,
    /// Index of the first candidate.
    pub candidate: usize,
    /// Number of candidates.
    pub candidates: usize,
    /// Index of the first episode.
    pub episode: usize,
    /// Number of episodes of each candidate.
    pub episodes: usize,
    /// The server's id.
    pub server: u64,
    /// 1 for the first try.
    pub attempt: u32,
    /// Number of steps that the server took, if it is stepped.
    pub steps: Option<u64>,
    /// Start, seconds since 1970.
    pub started: f64,
    /// Duration in seconds.
    pub seconds: f64,
    /// How it ended.
    pub outcome: Outcome,
    /// Why it brought no results, as text; `None` if it did.
    pub error: Option<String>,
    /// Where in the simulation's code, if that is known: once for each reason.
    pub stack: Option<String>,
}

/// Worth telling the user.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Warning {
    /// For people.
    pub text: String,
    /// When it arose, seconds since 1970.
    pub time: f64,
    /// The evaluation that has failed for good, if it is about one.
    pub failed: Option<FailedEvaluation>,
    /// Whether it is about results that count without audits.
    pub unaudited: bool,
}

impl Warning {
    /// It arises now.
    pub(crate) fn now(text: String) -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            text,
            time: since_1970.unwrap_or_default().as_secs_f64(),
            ..Self::default()
        }
    }
}

/// An evaluation that has failed for good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FailedEvaluation {
    /// Index of the candidate.
    pub candidate: usize,
    /// Index of the episode.
    pub episode: usize,
    /// Number of servers that failed with it, so that it is in quarantine; `None` if it failed by itself.
    pub quarantined: Option<u32>,
}

/// Attempts that have not been handed out yet, each with its start.
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

    /// All but the first `count` attempts.
    pub fn after(&self, count: usize) -> &[(Attempt, Instant)] {
        self.attempts.get(count..).unwrap_or_default()
    }

    /// The attempts since the last call.
    pub fn take(&mut self) -> Vec<(Attempt, Instant)> {
        std::mem::take(&mut self.attempts)
    }
}
