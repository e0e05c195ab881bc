//! How much work goes to which server at once, and which servers are of use.

use std::time::Instant;

use crate::mode::Way;
use crate::scheduler::fleet::capacity::{Capacity, number};
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::view::View;

/// Work that a block should hold, in seconds of its server: much more than a message takes, little enough to share.
const BLOCK_SECONDS: f64 = 0.020;
/// Less than this is not worth a message of its own.
const MIN_BLOCK_SECONDS: f64 = 0.0003;
/// A server's share is not divided when it takes no longer: a block that waits is there so that the server need not, and
/// half a share may fill half of the server's lanes.
const MIN_SHARED_SECONDS: f64 = 0.004;
/// Numbers in a message, at most: with half a MiB all who copy it on its way do so in their caches (measured: 1.6 times
/// the speed of 4 MiB and more).
const MAX_NUMBERS: usize = 1 << 17;
/// Numbers that a server makes for one message, at most.
const MAX_MADE: usize = 8 * MAX_NUMBERS;
/// Bytes of a packet beside its payload, and of a message beside what is counted, at most.
const OVERHEAD_BYTES: usize = 512;
/// Numbers that take the room of a seed.
const NUMBERS_PER_SEED: usize = 2;
/// Numbers of a batch's row beside its sensors: episode and agent.
const ROW_OVERHEAD: usize = 2;
/// Blocks in flight to one server: one is computed, one waits.
pub(crate) const IN_FLIGHT: usize = 2;
/// A server is passed over when it would be done later than all others with all that is left, by more seconds than these.
const GRACE_SECONDS: f64 = 0.005;
/// Factor by which a server may be slower, if the time of all others is not computed.
const MAX_SLOWDOWN: f64 = 2.0;

/// The lease of a block: it is given to another server when it takes this many times as long as expected.
const LEASE: f64 = 10.0;
/// How often a block is given more time since it was not answered in time.
const MOST_LATE: u32 = 3;

/// A number of evaluations from a measured speed.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "limited to what an index can be"
)]
fn count(evaluations: f64) -> usize {
    evaluations.ceil().clamp(1.0, 1e12) as usize
}

impl View<'_> {
    /// How many evaluations a server gets at once.
    pub fn most(&self, slot: &Slot, capacity: &Capacity) -> usize {
        let most = match slot.way {
            Way::Stepwise => 1,
            Way::Batched(batch) => batch.min(count(self.share(slot, capacity))),
            // A first one tells how fast the server is.
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
        // A batch has one set of parameters.
        let most = match slot.way {
            Way::Batched(_) if !work.architecture().steers() => most.min(work.episodes()),
            _ => most,
        };
        let numbers = self.numbers();
        // All agents of a batch are in one message a step.
        let most = match (slot.way, self.agents, self.sizes()) {
            (Way::Batched(_), Some(agents), Some((sensors, actuators))) => {
                let row = sensors.max(actuators).saturating_add(ROW_OVERHEAD);
                let agents = usize::try_from(agents).unwrap_or(usize::MAX);
                most.min((numbers / row.saturating_mul(agents).max(1)).max(1))
            }
            _ => most,
        };
        let (weights, episodes) = (work.architecture().weight_count(), work.episodes());
        // All of a block's candidates have the same seeds.
        let seeds = if numbers < MAX_NUMBERS {
            NUMBERS_PER_SEED.saturating_mul(episodes)
        } else {
            0
        };
        let fitting = if numbers < MAX_NUMBERS && numbers < weights.saturating_add(seeds) {
            (numbers.saturating_sub(weights) / NUMBERS_PER_SEED).max(1)
        } else {
            // Servers that make the genomes get few numbers.
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

    /// Numbers in a message, at most: what is fast, and what the broker takes.
    fn numbers(&self) -> usize {
        let packet = self.limits.room();
        if packet >= 2 * size_of::<f32>() * MAX_NUMBERS {
            return MAX_NUMBERS;
        }
        let room = packet.saturating_sub(OVERHEAD_BYTES + self.limits.beside());
        (room / size_of::<f32>()).clamp(1, MAX_NUMBERS)
    }

    /// Whether the broker takes the largest block of a sample also as genomes, as another server may get it.
    fn is_wide(&self) -> bool {
        self.limits.room() >= 2 * size_of::<f32>() * MAX_MADE
    }

    /// How many of its share a server computes in about the time of one.
    fn together(&self, slot: &Slot, capacity: &Capacity) -> usize {
        let announced = slot.capabilities.swarmwright.as_ref();
        match announced.and_then(|announced| announced.lanes) {
            Some(lanes) => lanes.min(count(self.share(slot, capacity))),
            None => 1,
        }
    }

    /// A server's part of the evaluations that are queued, by the speeds of all.
    fn share(&self, slot: &Slot, capacity: &Capacity) -> f64 {
        let queued = number(self.ledger.queued());
        match (capacity.rate(), slot.rate) {
            (Some(all), Some(rate)) => queued * rate / all,
            _ => queued / number(capacity.usable),
        }
    }

    /// Seconds for which a server has a block.
    pub fn lease(&self, piece: &Piece, server: u64) -> f64 {
        let rate = self.fleet.slot(server).and_then(|slot| slot.rate);
        let expected = rate.map_or(0.0, |rate| LEASE * number(piece.len()) / rate);
        // A server may have become slower than it was when it was measured.
        let more = 4f64.powi(i32::try_from(piece.late.min(MOST_LATE)).unwrap_or(0));
        self.config.timeouts.step.as_secs_f64().max(expected) * more
    }

    /// Whether the work is done earlier with this server's help than without, if it gets `most` evaluations.
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
        // What failed somewhere may need just this server.
        if self.ledger.has_failures() {
            return true;
        }
        // However many the others are, one evaluation takes the fastest of them its time.
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
    /// In how many seconds a server would have done so many evaluations more, and in how many the others those that are
    /// queued; none where that is not worked out.
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

    /// Seconds that what a server has will still take it.
    fn busy_for(&self, slot: &Slot, rate: f64, now: Instant) -> f64 {
        let jobs = slot
            .jobs
            .iter()
            .filter_map(|job| self.in_flight.piece_of(job));
        jobs.enumerate()
            .map(|(index, (piece, since))| {
                let takes = number(piece.len()) / rate;
                // Of the first one a part is done; those behind it wait.
                match index {
                    0 => (takes - now.saturating_duration_since(since).as_secs_f64()).max(0.0),
                    _ => takes,
                }
            })
            .sum()
    }
}
