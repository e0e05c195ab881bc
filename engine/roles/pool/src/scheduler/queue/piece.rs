//! Pieces of work: evaluations that are sent together.

use std::ops::Range;

/// Consecutive evaluations with the same history.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Piece {
    pub evaluations: Range<usize>,
    /// Number of earlier attempts.
    pub tries: u32,
    /// Number of these attempts that were not answered in time.
    pub late: u32,
    pub purpose: Purpose,
    /// Servers on which it failed, or that evaluated it before if it is repeated; other servers are preferred.
    failed_on: Vec<u64>,
    /// Servers that must not get it.
    never_on: Vec<u64>,
    /// Largest number of its evaluations per request. It shrinks with each failure until the evaluation that brings
    /// servers down is alone.
    largest: usize,
}

/// Purpose of evaluating a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// To get its results.
    Work,
    /// To get its results while a slow or silent server still has it; the first result counts.
    Backup,
    /// To compare the results with those of another server.
    Audit,
    /// To check whether a server is sound, with an evaluation that has succeeded.
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

    /// Creates a piece of one evaluation without history.
    pub fn again(evaluation: usize) -> Self {
        Self::new(evaluation..evaluation + 1)
    }

    /// Creates a piece of one evaluation that was done before on a server; other servers are preferred.
    pub fn repetition(evaluation: usize, before: Option<u64>) -> Self {
        Self {
            failed_on: before.into_iter().collect(),
            ..Self::again(evaluation)
        }
    }

    /// Creates a probe with an evaluation that has succeeded, for a server that may be broken.
    pub fn probe(evaluation: usize) -> Self {
        Self {
            purpose: Purpose::Probe,
            ..Self::again(evaluation)
        }
    }

    /// Returns whether it has failed on a server.
    pub fn has_failed_on(&self, server: u64) -> bool {
        self.failed_on.contains(&server)
    }

    /// Creates an audit of an evaluation, to be repeated on a server not in `never_on`.
    pub fn audit(evaluation: usize, never_on: Vec<u64>) -> Self {
        Self {
            purpose: Purpose::Audit,
            never_on,
            ..Self::new(evaluation..evaluation + 1)
        }
    }

    /// Creates a copy of the piece for any server but the current one.
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

    /// Returns a part with the same history.
    pub fn part(&self, evaluations: Range<usize>) -> Self {
        Self {
            evaluations,
            ..self.clone()
        }
    }

    /// Returns the parts before and after the given evaluations, with the same history.
    pub fn around(&self, evaluations: &Range<usize>) -> Vec<Self> {
        let before = self.first()..evaluations.start;
        let behind = evaluations.end..self.evaluations.end;
        let rest = [before, behind].into_iter().filter(|rest| !rest.is_empty());
        rest.map(|rest| self.part(rest)).collect()
    }

    /// Returns a part with the same history that any server may get.
    pub fn work_again(&self, evaluations: Range<usize>) -> Self {
        Self {
            purpose: Purpose::Work,
            never_on: Vec::new(),
            ..self.part(evaluations)
        }
    }

    /// Returns whether a server must not get it.
    pub fn is_kept_from(&self, server: u64) -> bool {
        self.never_on.contains(&server)
    }

    /// Returns the largest number of its evaluations per request.
    pub fn largest(&self) -> usize {
        self.largest
    }

    /// Returns the piece after a failure on a server.
    pub fn failed(mut self, server: u64) -> Self {
        self.largest = match self.tries {
            0 => self.len().div_ceil(8),
            _ => 1,
        };
        self.tries += 1;
        self.failed_on.push(server);
        self
    }

    /// Returns the piece after the connection broke. It is limited to half its size, in case it was too large for the
    /// broker.
    pub fn halved(mut self) -> Self {
        self.largest = self.largest.min(self.len().div_ceil(2));
        self
    }
}
