//! What waits for servers, and which server may have it.

use super::Ledger;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::queue::results::rectangle;

impl Ledger {
    /// Which piece is next for a server: one that it may have and has not failed, or which all of `servers` have.
    fn position(&self, server: u64, servers: &[u64]) -> Option<usize> {
        let position = self.queue.iter().position(|piece| {
            !self.needs_proof(piece, server) && self.may_have(piece, server, servers)
        });
        // A server that can be proven otherwise does not get what others were lost with, nor again what it failed.
        position.or_else(|| match self.good {
            Some(_) => None,
            None => self.barred(server, servers),
        })
    }

    /// Whether a server has to succeed with something else first: after others were lost with a piece, and after it
    /// failed it itself.
    fn needs_proof(&self, piece: &Piece, server: u64) -> bool {
        let attribution = &self.attribution;
        let evaluation = piece.first();
        (attribution.is_suspect(evaluation) && !attribution.is_proven(server))
            || attribution.is_open(evaluation, server)
    }

    /// What a server could have if it had succeeded with something.
    fn barred(&self, server: u64, servers: &[u64]) -> Option<usize> {
        if self.attribution.is_empty() {
            return None;
        }
        let mut queue = self.queue.iter();
        queue.position(|piece| self.may_have(piece, server, servers))
    }

    fn may_have(&self, piece: &Piece, server: u64, servers: &[u64]) -> bool {
        let free = !piece.is_kept_from(server) || !self.is_elsewhere(piece);
        let failed = |server: &u64| piece.has_failed_on(*server);
        let waits = self.attribution.must_wait(piece.first());
        free && !waits && (!failed(&server) || servers.iter().all(failed))
    }

    /// Whether nothing waits for a server but what it may have only once it has succeeded with something.
    pub fn waits_for_proof(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_none() && self.barred(server, servers).is_some()
    }

    /// Whether [`take`](Self::take) would give a server something.
    pub fn has_for(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_some()
    }

    /// A rectangle of at most `most` evaluations that this server may have and has not failed, or which all of `servers`
    /// have.
    pub fn take(&mut self, server: u64, servers: &[u64], most: usize) -> Option<Piece> {
        let position = self.position(server, servers)?;
        let episodes = self.episodes();
        let piece = &mut self.queue[position];
        let count = rectangle(&piece.evaluations, episodes, most.min(piece.largest()));
        let part = piece.part(piece.first()..piece.first() + count);
        piece.evaluations.start += count;
        if piece.evaluations.is_empty() {
            self.queue.remove(position);
        }
        self.queued -= count;
        Some(part)
    }

    /// Whether a server that must not have a piece is to be left out indeed: an audit always; a copy only as long as
    /// another server is at all of it.
    fn is_elsewhere(&self, piece: &Piece) -> bool {
        let shared = |evaluation| {
            self.place(evaluation)
                .is_none_or(|index| self.holders[index] > 1)
        };
        piece.purpose == Purpose::Audit || piece.evaluations.clone().all(shared)
    }

    /// What of a piece is not settled waits for a server again, before all else, unless another server has it.
    pub fn put_back(&mut self, piece: &Piece) {
        if piece.purpose == Purpose::Audit {
            self.queued += piece.len();
            return self.queue.push_back(piece.clone());
        }
        let mut waits = Vec::with_capacity(piece.len());
        for evaluation in piece.evaluations.clone() {
            waits.push(self.let_go(evaluation) == Some(0));
            if waits.last() == Some(&true)
                && let Some(index) = self.place(evaluation)
            {
                self.holders[index] = 1;
            }
        }
        // From the end on, so that the first comes first.
        let mut end = waits.len();
        while let Some(last) = waits[..end].iter().rposition(|waits| *waits) {
            let before = waits[..last].iter().rposition(|waits| !waits);
            let first = before.map_or(0, |index| index + 1);
            self.queued += last + 1 - first;
            let part = piece.first() + first..piece.first() + last + 1;
            self.queue.push_front(piece.work_again(part));
            end = first;
        }
    }

    /// Notes that a server no longer has an evaluation. Returns in how many other places it is; `None` if it has ended.
    pub(super) fn let_go(&mut self, evaluation: usize) -> Option<u8> {
        let index = self.place(evaluation)?;
        self.holders[index] = self.holders[index].saturating_sub(1);
        Some(self.holders[index])
    }

    /// Notes that what of a piece has not ended will be in one more place.
    pub fn hold(&mut self, piece: &Piece) {
        for evaluation in piece.evaluations.clone() {
            if let Some(index) = self.place(evaluation) {
                self.holders[index] = self.holders[index].saturating_add(1);
            }
        }
    }

    /// A copy of work under way, or an audit, waits for a server: copies before all else.
    pub fn queue(&mut self, piece: Piece) {
        if piece.purpose == Purpose::Backup {
            return self.queue_first(piece);
        }
        self.queued += piece.len();
        self.queue.push_back(piece);
    }

    /// Copies of what of a server's piece has not ended wait for other servers. Returns how many.
    pub fn queue_copies(&mut self, piece: &Piece, server: u64) -> u64 {
        let mut copies = 0;
        // Of a batch some episodes may be over.
        let mut rest = piece.evaluations.clone();
        while let Some(open) = self.first_open(&rest) {
            rest.start = open.end;
            let copy = piece.part(open).backup(server);
            self.hold(&copy);
            self.queue(copy);
            copies += 1;
        }
        copies
    }

    /// As [`queue`](Self::queue), before all else.
    pub fn queue_first(&mut self, piece: Piece) {
        self.queued += piece.len();
        self.queue.push_front(piece);
    }

    /// What is left of an evaluation waits until its failures are confirmed, unless another one has it.
    pub fn put_aside(&mut self, piece: Piece) {
        self.unqueue(piece.first());
        if self.let_go(piece.first()) == Some(0) {
            self.attribution.put_aside(piece);
        }
    }

    /// Takes an evaluation that was put aside and that a server has not failed.
    pub fn take_aside_for(&mut self, server: u64) -> Option<Piece> {
        let piece = self.attribution.take_aside_for(server)?;
        if let Some(index) = self.place(piece.first()) {
            self.holders[index] = 1;
        }
        Some(piece)
    }

    /// Takes an evaluation out of the queue, where a copy of it may wait, or its audit.
    pub fn unqueue(&mut self, evaluation: usize) {
        let holds = |piece: &Piece| piece.evaluations.contains(&evaluation);
        while let Some(position) = self.queue.iter().position(holds) {
            let Some(piece) = self.queue.remove(position) else {
                return;
            };
            let parts = [
                piece.first()..evaluation,
                evaluation + 1..piece.evaluations.end,
            ];
            self.queued -= 1;
            if piece.purpose != Purpose::Audit {
                self.let_go(evaluation);
            }
            for part in parts.into_iter().rev().filter(|part| !part.is_empty()) {
                self.queue.insert(position, piece.part(part));
            }
        }
    }
}
