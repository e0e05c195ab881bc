//! All servers that may get work, summed up once, so that a thousand of them are not looked at for each of a thousand.

use crate::machine::Machine;
use crate::slot::Slot;

/// What does not change while work is given away.
#[derive(Debug, Default)]
pub(crate) struct Crowd {
    /// Those for which what failed elsewhere may wait.
    pub servers: Vec<u64>,
    /// How many may get work now.
    pub usable: usize,
    /// Of these, those whose speed is known, and all their speeds together.
    measured: usize,
    rates: f64,
    /// The speeds of the fastest two.
    fastest: f64,
    second: f64,
}

/// The others, as one of the servers sees them.
pub(crate) struct Others {
    /// All their speeds together.
    pub rates: f64,
    /// The fastest one's.
    pub fastest: f64,
}

impl Crowd {
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

    /// All speeds together, if all are known.
    pub fn rate(&self) -> Option<f64> {
        (self.measured == self.usable).then_some(self.rates)
    }

    /// All but one; none when no other one's speed is known.
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

impl Machine {
    pub(crate) fn crowd(&self) -> Crowd {
        let mut crowd = Crowd {
            servers: self.usable_servers(),
            ..Crowd::default()
        };
        for slot in self.offers.slots.values().filter(|slot| slot.usable()) {
            crowd.add(slot);
        }
        crowd
    }
}
