//! Combined capacity of all usable servers, computed once so that dispatch does not scan all servers for each server.

use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::slot::Slot;

/// Largest number of servers for which the distribution of the remaining work is simulated.
const MAX_SIMULATED: usize = 256;
/// Number of bisection steps of that simulation.
const HALVINGS: usize = 24;

#[expect(
    clippy::cast_precision_loss,
    reason = "far fewer than 2^53 evaluations"
)]
pub(crate) fn number(count: usize) -> f64 {
    count as f64
}

/// Totals that do not change while work is dispatched.
#[derive(Default)]
pub(crate) struct Capacity {
    /// Servers for which failed work may wait.
    pub servers: Vec<u64>,
    /// Number of servers that may get work now.
    pub usable: usize,
    /// Number of usable servers whose speed is known, and the sum of their speeds in evaluations per second.
    measured: usize,
    rates: f64,
    /// Speeds of the two fastest servers.
    fastest: f64,
    second: f64,
    /// Servers whose speed is known; computed when first needed.
    busy: Vec<Busy>,
}

/// A server whose speed is known, and when it will be idle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Busy {
    server: u64,
    pub rate: f64,
    /// Seconds until its current work is done.
    pub until: f64,
}

/// Speeds of all servers but one.
pub(crate) struct Others {
    /// Sum of the speeds.
    pub rates: f64,
    /// Speed of the fastest one.
    pub fastest: f64,
}

impl Capacity {
    pub fn of(fleet: &Fleet) -> Self {
        let mut capacity = Self {
            servers: fleet.servers(),
            ..Self::default()
        };
        for (_, slot) in fleet.usable() {
            capacity.add(slot);
        }
        capacity
    }

    fn add(&mut self, slot: &Slot) {
        self.usable += 1;
        let Some(rate) = slot.rate else { return };
        self.measured += 1;
        self.rates += rate;
        if rate > self.fastest {
            (self.fastest, self.second) = (rate, self.fastest);
        } else {
            self.second = self.second.max(rate);
        }
    }

    /// Returns the sum of all speeds, if all are known.
    pub fn rate(&self) -> Option<f64> {
        (self.measured == self.usable).then_some(self.rates)
    }

    /// Returns the speeds of all other servers; `None` if none of them is known.
    pub fn without(&self, slot: &Slot) -> Option<Others> {
        let own = slot.rate.filter(|_| slot.usable());
        if self.measured <= usize::from(own.is_some()) {
            return None;
        }
        let is_fastest = own.is_some_and(|own| own >= self.fastest);
        let fastest = if is_fastest {
            self.second
        } else {
            self.fastest
        };
        Some(Others {
            rates: (self.rates - own.unwrap_or(0.0)).max(fastest),
            fastest,
        })
    }
}

impl Capacity {
    /// Records that a server got work that takes `seconds`.
    pub fn gave(&mut self, server: u64, seconds: f64) {
        if let Some(busy) = self.busy.iter_mut().find(|busy| busy.server == server) {
            busy.until += seconds;
        }
    }

    /// Returns the speed of a server and when it will be idle; `None` if there are too many servers to simulate or the
    /// speed is unknown. `busy` returns how many seconds the current work of a server will take at a given speed.
    pub fn until(
        &mut self,
        server: u64,
        fleet: &Fleet,
        busy: impl Fn(&Slot, f64) -> f64,
    ) -> Option<Busy> {
        if self.busy.is_empty() {
            if self.measured > MAX_SIMULATED {
                return None;
            }
            self.busy = fleet
                .usable()
                .filter_map(|(id, slot)| {
                    Some(Busy {
                        server: id,
                        rate: slot.rate?,
                        until: busy(slot, slot.rate?),
                    })
                })
                .collect();
        }
        let mut busy = self.busy.iter();
        busy.find(|busy| busy.server == server).copied()
    }

    /// Returns the seconds in which all other servers can do this many further evaluations, each on a single server.
    pub fn done_without(&self, server: u64, evaluations: usize) -> f64 {
        let others = || self.busy.iter().filter(|busy| busy.server != server);
        let needed = number(evaluations);
        let done = |by: f64| {
            let each = others().map(|busy| ((by - busy.until) * busy.rate + 1e-6).floor().max(0.0));
            each.sum::<f64>() >= needed
        };
        let alone = others().map(|busy| busy.until + needed / busy.rate);
        let (mut early, mut late) = (0.0, alone.fold(f64::INFINITY, f64::min));
        for _ in 0..HALVINGS {
            let middle = (early + late) / 2.0;
            if done(middle) {
                late = middle;
            } else {
                early = middle;
            }
        }
        late
    }
}
