//! A request to a server: a block for offloaded evaluation, or a batch of episodes.

use std::time::{Duration, Instant};

use swarmwright_protocol::{Missing, PieceKind, Waiting};

use crate::journal::{Attempt, Outcome};
use crate::mode::Mode;
use crate::scheduler::modes::REPORT_TIMEOUT;
use crate::scheduler::modes::batch::Batch;
use crate::scheduler::queue::piece::Piece;

/// What was asked of a server and is not answered yet.
pub(crate) struct Request {
    pub server: u64,
    pub piece: Piece,
    /// Evaluations in it that failed by themselves, and are retried separately.
    apart: Vec<usize>,
    pub started: Instant,
    /// When the server last said something of use, or could begin with this.
    heard: Instant,
    lease: Duration,
    /// Whether it takes so long that another server has it, too.
    backed_up: bool,
    /// Whether the supervisor of the server was asked what became of it.
    overdue: bool,
    /// None for a block.
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

    /// When the server last said something of use, or could begin with this.
    pub fn heard(&self) -> Instant {
        self.heard
    }

    /// The server said something of use, or can begin with this.
    pub fn hear(&mut self, now: Instant) {
        self.heard = now;
    }

    /// The supervisor says that the server goes on computing.
    pub fn is_alive(&mut self, now: Instant) {
        self.hear(now);
        self.overdue = false;
    }

    /// Seconds that the server computed: its own word for it, as far as it can be true.
    pub fn seconds(&self, claim: f64, now: Instant) -> f64 {
        // Not since the reply before: where two are read at once, that is no time at all.
        let most = now.saturating_duration_since(self.started);
        if claim.is_finite() && claim > 0.0 {
            claim.min(most.as_secs_f64())
        } else {
            now.saturating_duration_since(self.heard).as_secs_f64()
        }
    }

    /// An evaluation failed by itself, and is tried again apart from the others.
    pub fn set_apart(&mut self, evaluation: usize) {
        self.apart.push(evaluation);
    }

    /// Whether all evaluations failed by themselves.
    pub fn all_failed(&self) -> bool {
        self.apart.len() >= self.piece.len()
    }

    /// Whether it takes so long that another server has it, too.
    pub fn has_backup(&self) -> bool {
        self.backed_up
    }

    /// Another server gets it, too.
    pub fn back_up(&mut self) {
        self.backed_up = true;
    }

    /// Its lease is over: whether the server's supervisor is to be asked first, once.
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

    /// What is to be tried again when it fails as a whole: all but what went its own way before.
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

    /// What is waited for.
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
