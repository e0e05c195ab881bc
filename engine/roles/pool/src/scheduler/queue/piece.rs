//! Pieces of work: evaluations that are given away together.

use std::ops::Range;

/// Evaluations in a row that have the same past.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Piece {
    pub evaluations: Range<usize>,
    /// Attempts made before.
    pub tries: u32,
    /// Of these, those that were not answered in time.
    pub late: u32,
    pub purpose: Purpose,
    /// Servers on which it failed, or that had it before where it is repeated: others are preferred.
    failed_on: Vec<u64>,
    /// Servers that are not to have it.
    never_on: Vec<u64>,
    /// How many of it may go in one request: fewer with each failure, so that in the end the one that brings servers
    /// down is alone.
    largest: usize,
}

/// What a piece is evaluated for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Its results.
    Work,
    /// The same, while another server that is slow or silent still has it: the first result counts.
    Backup,
    /// To see whether another server finds the same.
    Audit,
    /// To see whether a server is sound: it succeeded before.
    Probe,
}

impl Piece {
    pub fn new(evaluations: Range<usize>) -> Self {
        Self {
            evaluations,
            tries: 0,
            late: 0,
            purpose: Purpose::Work,
            failed_on: Vec::new(),
            never_on: Vec::new(),
            largest: usize::MAX,
        }
    }

    /// One evaluation from the beginning.
    pub fn again(evaluation: usize) -> Self {
        Self::new(evaluation..evaluation + 1)
    }

    /// One evaluation that a server has made before: other servers are preferred.
    pub fn repetition(evaluation: usize, before: Option<u64>) -> Self {
        Self {
            failed_on: before.into_iter().collect(),
            ..Self::again(evaluation)
        }
    }

    /// One evaluation that has succeeded, for a server that may be broken.
    pub fn probe(evaluation: usize) -> Self {
        Self {
            purpose: Purpose::Probe,
            ..Self::again(evaluation)
        }
    }

    /// Whether it has failed on a server.
    pub fn has_failed_on(&self, server: u64) -> bool {
        self.failed_on.contains(&server)
    }

    /// One evaluation, to be repeated elsewhere than on some servers.
    pub fn audit(evaluation: usize, never_on: Vec<u64>) -> Self {
        Self {
            purpose: Purpose::Audit,
            never_on,
            ..Self::new(evaluation..evaluation + 1)
        }
    }

    /// The same work for a server other than the present one.
    pub fn backup(&self, server: u64) -> Self {
        Self {
            purpose: Purpose::Backup,
            never_on: vec![server],
            ..self.clone()
        }
    }

    pub fn first(&self) -> usize {
        self.evaluations.start
    }

    pub fn len(&self) -> usize {
        self.evaluations.len()
    }

    /// A part of it, with the same past.
    pub fn part(&self, evaluations: Range<usize>) -> Self {
        Self {
            evaluations,
            ..self.clone()
        }
    }

    /// The parts before and after some of it, with the same history.
    pub fn around(&self, evaluations: &Range<usize>) -> Vec<Self> {
        let before = self.first()..evaluations.start;
        let behind = evaluations.end..self.evaluations.end;
        let rest = [before, behind].into_iter().filter(|rest| !rest.is_empty());
        rest.map(|rest| self.part(rest)).collect()
    }

    /// A part of it with the same history, for any server.
    pub fn work_again(&self, evaluations: Range<usize>) -> Self {
        Self {
            purpose: Purpose::Work,
            never_on: Vec::new(),
            ..self.part(evaluations)
        }
    }

    /// Whether a server is not to have it.
    pub fn is_kept_from(&self, server: u64) -> bool {
        self.never_on.contains(&server)
    }

    /// How many of it may go in one request.
    pub fn largest(&self) -> usize {
        self.largest
    }

    /// What it is after a failure on a server.
    pub fn failed(mut self, server: u64) -> Self {
        self.largest = match self.tries {
            0 => self.len().div_ceil(8),
            _ => 1,
        };
        self.tries += 1;
        self.failed_on.push(server);
        self
    }

    /// What it is after the connection broke that it was sent over: should it have been too much for the broker, it
    /// will not be for ever.
    pub fn halved(mut self) -> Self {
        self.largest = self.largest.min(self.len().div_ceil(2));
        self
    }
}
