//! Queued pieces, and which server may get them.

use super::Ledger;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::queue::results::rectangle;

impl Ledger {
    /// Returns the position of the next piece for a server: one that it may have, and that has not failed on it or has
    /// failed on all of `servers`.
    fn position(&self, server: u64, servers: &[u64]) -> Option<usize> {
        let position = self.queue.iter().position(|piece| {
            !self.needs_proof(piece, server) && self.may_have(piece, server, servers)
        });
        // A server that can prove itself otherwise does not get pieces with which servers were lost, or that it has
        // failed.
        position.or_else(|| match self.good {
            Some(_) => None,
            None => self.barred(server, servers),
        })
    }

    /// Returns whether a server must first succeed with another evaluation, because servers were lost with the piece or
    /// the server itself has failed it.
    fn needs_proof(&self, piece: &Piece, server: u64) -> bool {
        let attribution = &self.attribution;
        let evaluation = piece.first();
        (attribution.is_suspect(evaluation) && !attribution.is_proven(server))
            || attribution.is_open(evaluation, server)
    }

    /// Returns the position of a piece that the server may have once it has proved itself.
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

    /// Returns whether all pieces for a server wait until it has proved itself.
    pub fn waits_for_proof(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_none() && self.barred(server, servers).is_some()
    }

    /// Returns whether [`take`](Self::take) would return a piece for a server.
    pub fn has_for(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_some()
    }

    /// Takes a rectangle of at most `most` evaluations that the server may have, and that have not failed on it or have
    /// failed on all of `servers`.
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

    /// Returns whether a piece must be kept from the servers that it excludes: an audit always, a copy only as long as
    /// another server is working on all of it.
    fn is_elsewhere(&self, piece: &Piece) -> bool {
        let shared = |evaluation| {
            self.place(evaluation)
                .is_none_or(|index| self.holders[index] > 1)
        };
        piece.purpose == Purpose::Audit || piece.evaluations.clone().all(shared)
    }

    /// Queues the unfinished evaluations of a piece again, at the front, except those that another server has.
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
        // Backwards, so that the first part ends up at the front.
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

    /// Records that a server no longer has an evaluation. Returns the number of other places; `None` if it has ended.
    pub(super) fn let_go(&mut self, evaluation: usize) -> Option<u8> {
        let index = self.place(evaluation)?;
        self.holders[index] = self.holders[index].saturating_sub(1);
        Some(self.holders[index])
    }

    /// Records that the unfinished evaluations of a piece will be in one more place.
    pub fn hold(&mut self, piece: &Piece) {
        for evaluation in piece.evaluations.clone() {
            if let Some(index) = self.place(evaluation) {
                self.holders[index] = self.holders[index].saturating_add(1);
            }
        }
    }

    /// Queues a copy of work in flight at the front, or an audit at the end.
    pub fn queue(&mut self, piece: Piece) {
        if piece.purpose == Purpose::Backup {
            return self.queue_first(piece);
        }
        self.queued += piece.len();
        self.queue.push_back(piece);
    }

    /// Queues copies of the unfinished evaluations of a server's piece for other servers. Returns the number of copies.
    pub fn queue_copies(&mut self, piece: &Piece, server: u64) -> u64 {
        let mut copies = 0;
        // Some episodes of a batch may have ended.
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

    /// Queues a piece at the front.
    pub fn queue_first(&mut self, piece: Piece) {
        self.queued += piece.len();
        self.queue.push_front(piece);
    }

    /// Puts an evaluation aside until its failures are confirmed, unless another server has it.
    pub fn put_aside(&mut self, piece: Piece) {
        self.unqueue(piece.first());
        if self.let_go(piece.first()) == Some(0) {
            self.attribution.put_aside(piece);
        }
    }

    /// Takes back one evaluation that was put aside and has not failed on a server.
    pub fn take_aside_for(&mut self, server: u64) -> Option<Piece> {
        let piece = self.attribution.take_aside_for(server)?;
        if let Some(index) = self.place(piece.first()) {
            self.holders[index] = 1;
        }
        Some(piece)
    }

    /// Removes an evaluation, a copy of it, or its audit from the queue.
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
