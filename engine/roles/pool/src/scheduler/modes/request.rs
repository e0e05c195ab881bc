//! A request to a server: a block for offloaded evaluation, or a batch of episodes.

use std::time::{Duration, Instant};

use swarmwright_protocol::{Missing, PieceKind, Waiting};

use crate::journal::{Attempt, Outcome};
use crate::mode::Mode;
use crate::scheduler::modes::REPORT_TIMEOUT;
use crate::scheduler::modes::batch::Batch;
use crate::scheduler::queue::piece::Piece;

/// A request that has not been answered completely.
pub(crate) struct Request {
    pub server: u64,
    pub piece: Piece,
    /// Evaluations of the request that failed individually and are retried separately.
    apart: Vec<usize>,
    pub started: Instant,
    /// When the server last sent a usable message, or could begin this request.
    heard: Instant,
    lease: Duration,
    /// Whether another server has the work as well because this one is slow.
    backed_up: bool,
    /// Whether the supervisor of the server has been asked about it.
    overdue: bool,
    /// State of a batch; `None` for a block.
    pub batch: Option<Batch>,
}

impl Request {
    pub fn new(
        piece: Piece,
        server: u64,
        lease: Duration,
        batch: Option<Batch>,
        now: Instant,
    ) -> Self {
        Self {
            server,
            piece,
            apart: Vec::new(),
            started: now,
            heard: now,
            lease,
            backed_up: false,
            overdue: false,
            batch,
        }
    }

    /// Returns when the server last sent a usable message, or could begin this request.
    pub fn heard(&self) -> Instant {
        self.heard
    }

    /// Records that the server sent a usable message, or can begin this request.
    pub fn hear(&mut self, now: Instant) {
        self.heard = now;
    }

    /// Records that the supervisor reported that the server continues.
    pub fn is_alive(&mut self, now: Instant) {
        self.hear(now);
        self.overdue = false;
    }

    /// Returns the seconds of computation that the server claims, limited to the time since the request; without a
    /// valid claim, the time since the last message.
    pub fn seconds(&self, claim: f64, now: Instant) -> f64 {
        // The time since the last reply would be 0 for the second of two replies that are read at once.
        let most = now.saturating_duration_since(self.started);
        if claim.is_finite() && claim > 0.0 {
            claim.min(most.as_secs_f64())
        } else {
            now.saturating_duration_since(self.heard).as_secs_f64()
        }
    }

    /// Marks an evaluation that failed individually and is retried separately.
    pub fn set_apart(&mut self, evaluation: usize) {
        self.apart.push(evaluation);
    }

    /// Returns whether all evaluations failed individually.
    pub fn all_failed(&self) -> bool {
        self.apart.len() >= self.piece.len()
    }

    /// Returns whether another server has the work as well because this one is slow.
    pub fn has_backup(&self) -> bool {
        self.backed_up
    }

    /// Records that another server gets the work as well.
    pub fn back_up(&mut self) {
        self.backed_up = true;
    }

    /// Returns whether to ask the server's supervisor before the lease ends; this is done once.
    pub fn asks_supervisor(&mut self) -> bool {
        !std::mem::replace(&mut self.overdue, true)
    }

    pub fn deadline(&self) -> Instant {
        let word = if self.overdue {
            REPORT_TIMEOUT
        } else {
            Duration::ZERO
        };
        self.heard + self.lease + word
    }

    /// Returns the pieces to retry if the request fails as a whole: all but the evaluations that are retried
    /// separately.
    pub fn rest(&self) -> Vec<Piece> {
        let mut rest = Vec::new();
        let mut start = self.piece.first();
        let mut apart = self.apart.clone();
        apart.sort_unstable();
        for end in apart.into_iter().chain([self.piece.evaluations.end]) {
            if start < end {
                rest.push(self.piece.part(start..end));
            }
            start = end + 1;
        }
        rest
    }

    pub fn attempt(&self, outcome: Outcome, error: Option<String>) -> Attempt {
        Attempt {
            mode: if self.batch.is_some() {
                Mode::Batched.name()
            } else {
                Mode::Offloaded.name()
            },
            server: self.server,
            outcome,
            error,
            ..Attempt::default()
        }
    }

    /// Describes the message that the request waits for.
    pub fn waiting_for(&self, now: Instant) -> Waiting {
        let (kind, missing) = match &self.batch {
            None => (PieceKind::Block, Missing::Result),
            Some(batch) if !batch.steers() => (PieceKind::Batch, Missing::Result),
            Some(batch) if batch.steps() == 0 => (PieceKind::Batch, Missing::Start),
            Some(_) => (PieceKind::Batch, Missing::Sensors),
        };
        let steps = self
            .batch
            .as_ref()
            .and_then(|batch| batch.steps().checked_sub(1));
        Waiting {
            server: self.server,
            kind,
            missing,
            evaluations: self.piece.len() as u64,
            agent: None,
            step: steps,
            silent: now.saturating_duration_since(self.heard).as_secs_f64(),
        }
    }
}
