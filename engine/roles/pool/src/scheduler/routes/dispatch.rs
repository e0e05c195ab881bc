//! Dispatch of work to servers; [`share`](crate::scheduler::share) decides how much each gets, and
//! [`speculation`](crate::scheduler::speculation) which work gets a backup copy.

use std::time::{Duration, Instant};

use crate::mode::Way;
use crate::scheduler::Scheduler;
use crate::scheduler::fleet::capacity::{Capacity, number};
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::share::IN_FLIGHT;

/// Interval between checks whether a backup copy has become worthwhile.
const RECHECK_INTERVAL: Duration = Duration::from_millis(20);

impl Scheduler {
    /// Gives work to every server that has room for it, idle servers first.
    pub(super) fn dispatch(&mut self, now: Instant) {
        self.fleet.suspend(self.ledger.good().is_some());
        self.resolve(now);
        if self.ledger.queued() > 0 {
            self.recheck.clear();
            self.give_away(now);
        }
        self.probe(now);
        self.start_backups(now);
        self.outlook.judge(&self.fleet, self.ledger.finished(), now);
    }

    fn give_away(&mut self, now: Instant) {
        let mut capacity = None;
        for jobs in 0..IN_FLIGHT {
            let room = |slot: &Slot| {
                slot.usable()
                    && slot.jobs.len() == jobs
                    && (jobs == 0 || slot.way == Way::Offloaded)
            };
            let slots = self.fleet.slots().filter(|(_, slot)| room(slot));
            let servers: Vec<u64> = slots.map(|(id, _)| id).collect();
            if servers.is_empty() {
                continue;
            }
            let capacity = capacity.get_or_insert_with(|| Capacity::of(&self.fleet));
            for server in servers {
                if self.ledger.queued() == 0 {
                    return;
                }
                self.give(server, capacity, now);
            }
        }
    }

    fn give(&mut self, server: u64, capacity: &mut Capacity, now: Instant) {
        let Some(slot) = self.fleet.slot(server) else {
            return;
        };
        let most = self.view().most(slot, capacity);
        let alone = slot.rate.map_or(0.0, |rate| number(most) / rate);
        if !self.view().is_worth_while(server, most, capacity, now)
            && !self.has_waited(server, alone, now)
        {
            return;
        }
        if !self.fleet.consider(server) {
            return;
        }
        let Some(piece) = self.ledger.take(server, &capacity.servers, most) else {
            return;
        };
        capacity.gave(server, alone);
        self.start(piece, server, now);
    }

    /// Starts a piece on a server.
    pub(super) fn start(&mut self, piece: Piece, server: u64, now: Instant) {
        match self.fleet.slot(server).map(|slot| slot.way) {
            Some(Way::Stepwise) => self.start_episode(piece, server, now),
            Some(Way::Batched(_)) => self.start_batch(piece, server, now),
            Some(Way::Offloaded) => self.send_block(piece, server, now),
            None => self.ledger.put_back(&piece),
        }
    }

    /// Returns whether an idle server has been passed over for longer than it would have needed for the work itself,
    /// which means that the other servers are slower than measured.
    fn has_waited(&mut self, server: u64, alone: f64, now: Instant) -> bool {
        let Some(since) = self.fleet.pass_over(server, now) else {
            return false;
        };
        let Some(end) = Duration::try_from_secs_f64(alone)
            .ok()
            .and_then(|alone| since.checked_add(alone))
        else {
            return false;
        };
        if end < now {
            return true;
        }
        let end = end + Duration::from_millis(1);
        self.recheck.hasten(end);
        false
    }

    /// Gives the work of stragglers to other servers as well.
    pub(super) fn back_up_stragglers(&mut self, now: Instant) {
        for server in self.view().stragglers(now) {
            self.speculate(server, now);
        }
    }

    fn speculate(&mut self, server: u64, now: Instant) {
        let (pieces, words) = self.in_flight.back_up(server, now);
        self.fleet.fell_silent(server);
        let mut dispatched = false;
        for piece in pieces.into_iter().rev() {
            if self.view().may_copy(&piece) && !self.view().is_shared(&piece) {
                let copies = self.ledger.queue_copies(&piece, server);
                self.counts.backups += copies;
                dispatched |= copies > 0;
            }
        }
        if dispatched {
            let once = if self.fleet.has_other(server) {
                ""
            } else {
                " once there is one"
            };
            self.outbox.warn(format!(
                "{words}, much longer than ever before; the work goes to another server as well{once}"
            ));
        }
    }

    /// While the queue is empty, gives idle servers copies of work that others would need much longer for.
    pub(super) fn start_backups(&mut self, now: Instant) {
        if !self.config.faults.backup || self.config.visual || self.ledger.queued() > 0 {
            return;
        }
        // With a thousand servers, checking after every message would be too slow.
        if self.recheck.is_ahead(now) {
            return;
        }
        self.recheck.clear();
        let idle = self.view().idle();
        if idle.is_empty() {
            return;
        }
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
