//! Shares of work: how much each server gets at once, and which servers are worth using.

use std::time::Instant;

use crate::mode::Way;
use crate::scheduler::fleet::capacity::{Capacity, number};
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::view::View;

/// Duration of a block in seconds: much longer than a message takes, short enough to share the work evenly.
const BLOCK_SECONDS: f64 = 0.020;
/// Seconds of work below which a message of its own is not worthwhile.
const MIN_BLOCK_SECONDS: f64 = 0.0003;
/// Seconds up to which a server's share is not divided. The second of two blocks only keeps the server from waiting,
/// and half a share may fill only half of the server's lanes.
const MIN_SHARED_SECONDS: f64 = 0.004;
/// Largest number of values in a message: half a MiB fits into the caches of all who copy it on its way (measured: 1.6
/// times the speed of 4 MiB and more).
const MAX_NUMBERS: usize = 1 << 17;
/// Largest number of values that a server generates for one message.
const MAX_MADE: usize = 8 * MAX_NUMBERS;
/// Largest size in bytes of a packet without its payload, plus the uncounted parts of the payload.
const OVERHEAD_BYTES: usize = 512;
/// Number of values that take as many bytes as a seed.
const NUMBERS_PER_SEED: usize = 2;
/// Number of values in a row of a batch besides its sensors: episode and agent.
const ROW_OVERHEAD: usize = 2;
/// Number of blocks in flight per server: one is computed, one waits.
pub(crate) const IN_FLIGHT: usize = 2;
/// Seconds by which a server may finish later than all others would with the remaining work before it is passed over.
const GRACE_SECONDS: f64 = 0.005;
/// Factor by which a server may be slower, if the time of all others is not computed.
const MAX_SLOWDOWN: f64 = 2.0;

/// Lease of a block in multiples of its expected duration; another server gets the block afterwards.
const LEASE: f64 = 10.0;
/// Largest number of times that the lease of a block is extended after it expired.
const MOST_LATE: u32 = 3;

/// Converts a number of evaluations computed from a measured speed.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "limited to what an index can be"
)]
fn count(evaluations: f64) -> usize {
    evaluations.ceil().clamp(1.0, 1e12) as usize
}

impl View<'_> {
    /// Returns the number of evaluations that a server gets at once.
    pub fn most(&self, slot: &Slot, capacity: &Capacity) -> usize {
        let most = match slot.way {
            Way::Stepwise => 1,
            Way::Batched(batch) => batch.min(count(self.share(slot, capacity))),
            // The first request serves to measure the speed.
            Way::Offloaded => slot.rate.map_or(self.together(slot, capacity), |rate| {
                let share = self.share(slot, capacity);
                let part = if share <= rate * MIN_SHARED_SECONDS {
                    share
                } else {
                    share / number(IN_FLIGHT)
                };
                count(part.max(rate * MIN_BLOCK_SECONDS).min(rate * BLOCK_SECONDS))
                    .max(self.together(slot, capacity))
            }),
        };
        let Some(work) = self.ledger.work() else {
            return most;
        };
        // A batch has a single parameter set.
        let most = match slot.way {
            Way::Batched(_) if !work.architecture().steers() => most.min(work.episodes()),
            _ => most,
        };
        let numbers = self.numbers();
        // One message per step holds all agents of a batch.
        let most = match (slot.way, self.agents, self.sizes()) {
            (Way::Batched(_), Some(agents), Some((sensors, actuators))) => {
                let row = sensors.max(actuators).saturating_add(ROW_OVERHEAD);
                let agents = usize::try_from(agents).unwrap_or(usize::MAX);
                most.min((numbers / row.saturating_mul(agents).max(1)).max(1))
            }
            _ => most,
        };
        let (weights, episodes) = (work.architecture().weight_count(), work.episodes());
        // All candidates of a block share the seeds.
        let seeds = if numbers < MAX_NUMBERS {
            NUMBERS_PER_SEED.saturating_mul(episodes)
        } else {
            0
        };
        let fitting = if numbers < MAX_NUMBERS && numbers < weights.saturating_add(seeds) {
            (numbers.saturating_sub(weights) / NUMBERS_PER_SEED).max(1)
        } else {
            // A server that generates the genomes receives only few values.
            let sampled = work.is_sampled() && slot.makes_samples();
            let numbers = if sampled && self.is_wide() {
                MAX_MADE
            } else {
                numbers
            };
            ((numbers - seeds) / weights)
                .max(1)
                .saturating_mul(episodes)
        };
        most.min(fitting)
            .min(self.limits.at_once(slot.way))
            .min((numbers / 2 / (1 + self.config.demand.metrics.len())).max(1))
            .min(self.config.largest)
    }

    /// Returns the largest number of values in a message, limited by speed and by the broker.
    fn numbers(&self) -> usize {
        let packet = self.limits.room();
        if packet >= 2 * size_of::<f32>() * MAX_NUMBERS {
            return MAX_NUMBERS;
        }
        let room = packet.saturating_sub(OVERHEAD_BYTES + self.limits.beside());
        (room / size_of::<f32>()).clamp(1, MAX_NUMBERS)
    }

    /// Returns whether the broker also accepts the largest sampled block as genomes, since another server may get it.
    fn is_wide(&self) -> bool {
        self.limits.room() >= 2 * size_of::<f32>() * MAX_MADE
    }

    /// Returns the number of evaluations of its share that a server computes in about the time of one.
    fn together(&self, slot: &Slot, capacity: &Capacity) -> usize {
        let announced = slot.capabilities.swarmwright.as_ref();
        match announced.and_then(|announced| announced.lanes) {
            Some(lanes) => lanes.min(count(self.share(slot, capacity))),
            None => 1,
        }
    }

    /// Returns a server's share of the queued evaluations, in proportion to its speed.
    fn share(&self, slot: &Slot, capacity: &Capacity) -> f64 {
        let queued = number(self.ledger.queued());
        match (capacity.rate(), slot.rate) {
            (Some(all), Some(rate)) => queued * rate / all,
            _ => queued / number(capacity.usable),
        }
    }

    /// Returns the lease of a block in seconds.
    pub fn lease(&self, piece: &Piece, server: u64) -> f64 {
        let rate = self.fleet.slot(server).and_then(|slot| slot.rate);
        let expected = rate.map_or(0.0, |rate| LEASE * number(piece.len()) / rate);
        // The server may have become slower since it was measured.
        let more = 4f64.powi(i32::try_from(piece.late.min(MOST_LATE)).unwrap_or(0));
        self.config.timeouts.step.as_secs_f64().max(expected) * more
    }

    /// Returns whether the work finishes earlier if this server gets `most` evaluations.
    pub fn is_worth_while(
        &self,
        server: u64,
        most: usize,
        capacity: &mut Capacity,
        now: Instant,
    ) -> bool {
        let Some(slot) = self.fleet.slot(server) else {
            return false;
        };
        let (Some(rate), Some(others)) = (slot.rate, capacity.without(slot)) else {
            return true;
        };
        // Failed work may need this server.
        if self.ledger.has_failures() {
            return true;
        }
        // Even with many other servers, one evaluation takes at least the time of the fastest one.
        let without = (number(self.ledger.queued()) / others.rates).max(1.0 / others.fastest);
        let all = number(IN_FLIGHT * most) / rate;
        if all <= without {
            return true;
        }
        match self.ends(server, most, capacity, now) {
            Some((ends, without)) => ends <= without + GRACE_SECONDS,
            None => number(most) / rate <= MAX_SLOWDOWN * without + GRACE_SECONDS,
        }
    }
}

impl View<'_> {
    /// Returns in how many seconds a server would have done `most` further evaluations, and in how many the others
    /// would have done the queued ones; `None` if this is not computed.
    fn ends(
        &self,
        server: u64,
        most: usize,
        capacity: &mut Capacity,
        now: Instant,
    ) -> Option<(f64, f64)> {
        let busy = |slot: &Slot, rate: f64| self.busy_for(slot, rate, now);
        let own = capacity.until(server, self.fleet, busy)?;
        let ends = own.until + number(most) / own.rate;
        Some((ends, capacity.done_without(server, self.ledger.queued())))
    }

    /// Returns the seconds that the current jobs of a server will still take.
    fn busy_for(&self, slot: &Slot, rate: f64, now: Instant) -> f64 {
        let jobs = slot
            .jobs
            .iter()
            .filter_map(|job| self.in_flight.piece_of(job));
        jobs.enumerate()
            .map(|(index, (piece, since))| {
                let takes = number(piece.len()) / rate;
                // The first job is partly done; the others wait.
                match index {
                    0 => (takes - now.saturating_duration_since(since).as_secs_f64()).max(0.0),
                    _ => takes,
                }
            })
            .sum()
    }
}
