//! Backup copies are queued and started; what is worth a copy is decided in [`speculation`](super::speculation).

use std::time::{Duration, Instant};

use crate::scheduler::Scheduler;
use crate::scheduler::queue::piece::Piece;

/// How often it is looked whether one has become worth while.
const RECHECK_INTERVAL: Duration = Duration::from_millis(20);

impl Scheduler {
    /// Gives the work of servers that have been silent for strangely long to others as well.
    pub(super) fn back_up_stragglers(&mut self, now: Instant) {
        for server in self.view().stragglers(now) {
            self.speculate(server, now);
        }
    }

    fn speculate(&mut self, server: u64, now: Instant) {
        let mut pieces = Vec::new();
        let mut words = String::new();
        for run in self.in_flight.episodes_of(server) {
            run.back_up();
            words = run.waiting_for(now).to_string();
            pieces.push(run.piece.clone());
        }
        for request in self.in_flight.requests_of(server) {
            request.back_up();
            if words.is_empty() {
                words = request.waiting_for(now).to_string();
            }
            pieces.push(request.piece.clone());
        }
        self.fleet.fell_silent(server);
        let mut given = false;
        pieces.sort_by_key(Piece::first);
        for piece in pieces.into_iter().rev() {
            if self.view().may_copy(&piece) && !self.view().is_shared(&piece) {
                // Of a batch some episodes may be over.
                let mut rest = piece.evaluations.clone();
                while let Some(open) = self.ledger.first_open(&rest) {
                    rest.start = open.end;
                    let copy = piece.part(open).backup(server);
                    self.ledger.hold(&copy);
                    self.ledger.queue(copy);
                    self.counts.backups += 1;
                    given = true;
                }
            }
        }
        if given {
            let once = if self.has_other(server) {
                ""
            } else {
                " once there is one"
            };
            self.outbox.warn(format!(
                "{words}, much longer than ever before; the work goes to another server as well{once}"
            ));
        }
    }

    /// Whether there is another server than this one.
    fn has_other(&self, server: u64) -> bool {
        self.fleet.slots().any(|(id, _)| id != server)
    }

    /// Where what this server failed is tried again, in words.
    pub(super) fn again(&self, server: u64) -> &'static str {
        if self.has_other(server) {
            " elsewhere"
        } else {
            "; there is no other server"
        }
    }

    /// Nothing is queued any more: idle servers get copies of what others would take much longer for.
    pub(super) fn start_backups(&mut self, now: Instant) {
        if !self.config.faults.backup || self.config.visual || self.ledger.queued() > 0 {
            return;
        }
        // Not after each of a thousand servers' messages.
        if self.recheck.is_ahead(now) {
            return;
        }
        self.recheck.clear();
        let idle = self.fleet.usable().filter(|(_, slot)| slot.jobs.is_empty());
        let mut idle: Vec<(f64, u64)> = idle
            .filter_map(|(id, slot)| Some((slot.rate?, id)))
            .collect();
        if idle.is_empty() {
            return;
        }
        idle.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
        let mut under_way = self.view().under_way(now);
        for (rate, server) in idle {
            if under_way.is_empty() {
                return;
            }
            let Some(copy) = self.view().slowest(server, rate, &under_way) else {
                self.recheck.set(now + RECHECK_INTERVAL);
                continue;
            };
            self.ledger.hold(&copy);
            self.counts.backups += 1;
            self.start(copy, server, now);
            under_way.retain(|other| !self.view().is_shared(&other.open));
        }
    }
}
