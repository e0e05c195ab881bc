//! Servers that do not fit the experiment or the other servers of the run.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use swarmwright_protocol::Capabilities;

use crate::demand::Demand;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::sizes::{Sizes, announced};

impl Fleet {
    /// Settles the numbers of sensors and actuators when the run begins: those that most servers announce, in a tie
    /// those of the lowest id. Excludes the servers that announce other numbers and returns them with the reason.
    pub fn settle_sizes(&mut self) -> Vec<(u64, String)> {
        self.settles_sizes = true;
        if self.sizes.is_some() {
            return Vec::new();
        }
        let mut votes: BTreeMap<(usize, usize), (usize, u64)> = BTreeMap::new();
        for (id, slot) in &self.slots {
            if let Some(sizes) = announced(&slot.capabilities) {
                votes.entry(sizes).or_insert((0, *id)).0 += 1;
            }
        }
        let most = votes
            .into_iter()
            .max_by_key(|(_, (votes, id))| (*votes, Reverse(*id)));
        let Some(((sensors, actuators), (_, server))) = most else {
            return Vec::new();
        };
        let sizes = Sizes {
            sensors,
            actuators,
            server,
        };
        self.sizes = Some(sizes);
        let slots = self.slots.iter();
        let others = slots.filter_map(|(id, slot)| Some((*id, sizes.misfit(&slot.capabilities)?)));
        let others: Vec<(u64, String)> = others.collect();
        for (id, reason) in &others {
            self.unfit.insert(*id, reason.clone());
            self.slots.remove(id);
        }
        others
    }

    /// Settles the numbers from a fitting server if the run has begun and no other server has announced any.
    pub(super) fn note_sizes(&mut self, id: u64, capabilities: &Capabilities) {
        if self.settles_sizes
            && self.sizes.is_none()
            && let Some((sensors, actuators)) = announced(capabilities)
        {
            self.sizes = Some(Sizes {
                sensors,
                actuators,
                server: id,
            });
        }
    }

    /// Returns why a server does not fit; `None` if it fits.
    pub(super) fn misfit(
        &self,
        demand: &Demand,
        simulations: &[String],
        capabilities: &Capabilities,
    ) -> Option<String> {
        let of_run = || self.sizes.and_then(|sizes| sizes.misfit(capabilities));
        demand.misfit(simulations, capabilities).or_else(of_run)
    }
}
