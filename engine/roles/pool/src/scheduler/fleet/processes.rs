//! Servers whose processes this tool supervises, and the processes that have ended.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::scheduler::queue::blame::Blame;
use crate::scheduler::queue::piece::Piece;

/// Work that a process was computing when it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct At {
    /// Number of the request.
    pub request: u64,
    /// First candidate that was being computed, as an index in the request.
    pub first: usize,
    /// Number of candidates that were being computed.
    pub candidates: usize,
    /// Episode of the request, from 0; `None` if several are computed at once.
    pub episode: Option<usize>,
}

impl At {
    /// Returns the evaluations that were being computed, within the request's piece of `columns` episodes per
    /// candidate.
    pub(crate) fn evaluations(&self, columns: usize, piece: &Piece) -> Range<usize> {
        let offset = self.first * columns + self.episode.unwrap_or(0);
        let length = match self.episode {
            Some(_) => 1,
            None => self.candidates * columns,
        };
        let start = (piece.first() + offset).min(piece.evaluations.end);
        start..(start + length).min(piece.evaluations.end)
    }
}

/// The end of a server's process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ending {
    /// Id of the server.
    pub server: u64,
    /// Id of the process that ended.
    pub pid: u64,
    /// How the process ended, for users; the same text for the same cause.
    pub reason: String,
    /// Place in its code or its last output, if known.
    pub stack: Option<String>,
    /// Whether the process was ended from outside; its work is blamed only if this happens repeatedly.
    pub outside: bool,
    /// What it was computing, if known.
    pub at: Option<At>,
}

impl Ending {
    /// Returns how the work that was being computed is blamed.
    pub(crate) fn blame(&self) -> Blame {
        if self.outside {
            Blame::Gone
        } else {
            Blame::Crash
        }
    }
}

/// Servers whose processes are supervised, and the last process of each that ended.
#[derive(Debug, Default)]
pub(crate) struct Processes {
    watched: BTreeSet<u64>,
    ended: BTreeMap<u64, u64>,
}

impl Processes {
    pub fn watch(&mut self, servers: impl IntoIterator<Item = u64>) {
        self.watched.extend(servers);
    }

    /// Returns whether the process of a server is supervised.
    pub fn are_watched(&self, server: u64) -> bool {
        self.watched.contains(&server)
    }

    /// Records that the process of a server has ended.
    pub fn ended(&mut self, server: u64, pid: u64) {
        self.ended.insert(server, pid);
    }

    /// Returns whether `pid` is the last process of the server that ended.
    pub fn has_ended(&self, server: u64, pid: Option<u64>) -> bool {
        pid.is_some() && self.ended.get(&server).copied() == pid
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_computed_lies_within_the_piece() {
        // Candidates 2 to 5 with 3 episodes each.
        let piece = Piece::new(6..18);
        let at = |first, candidates, episode| At {
            request: 1,
            first,
            candidates,
            episode,
        };
        let around = |at: At| {
            let computed = at.evaluations(3, &piece);
            let rest = piece.around(&computed).into_iter();
            let rest: Vec<_> = rest.map(|rest| [rest.first(), rest.len()]).collect();
            (computed, rest)
        };
        assert_eq!(around(at(1, 1, Some(2))), (11..12, vec![[6, 5], [12, 6]]));
        assert_eq!(around(at(0, 2, None)), (6..12, vec![[12, 6]]));
        assert_eq!(around(at(2, 9, None)), (12..18, vec![[6, 6]]));
        assert_eq!(around(at(9, 1, None)), (18..18, vec![[6, 12]]));
    }
}
