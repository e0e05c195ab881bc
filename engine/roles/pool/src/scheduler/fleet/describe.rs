//! Descriptions of servers for users.

use std::collections::BTreeMap;

use swarmwright_protocol::{AnnouncedSide, State};

use crate::demand::Demand;
use crate::scheduler::fleet::Fleet;
use crate::sections::Timeouts;

impl Fleet {
    /// Returns the numbers of sensors and actuators that fitting servers announce, preferably both from the same
    /// server.
    pub fn sizes(&self) -> (Option<usize>, Option<usize>) {
        let announced = || {
            let slots = self.slots.values();
            slots.filter_map(|slot| slot.capabilities.swarmwright.as_ref())
        };
        let both = announced().find_map(|offer| Some((offer.sensors?, offer.actuators?)));
        match both {
            Some((sensors, actuators)) => (Some(sensors), Some(actuators)),
            None => (
                announced().find_map(|offer| offer.sensors),
                announced().find_map(|offer| offer.actuators),
            ),
        }
    }

    /// Returns a note if a fitting server is online but serves another tool.
    pub fn busy_elsewhere(&self, demand: &Demand) -> Option<String> {
        self.presences
            .values()
            .find(|presence| {
                presence.state == State::Busy
                    && self
                        .misfit(demand, &presence.simulations, &presence.capabilities)
                        .is_none()
            })
            .map(|presence| {
                let holder = presence
                    .tool
                    .as_deref()
                    .unwrap_or("another optimization tool");
                format!("server {} is busy for {holder}", presence.server)
            })
    }

    /// Describes all servers that were found; `None` if there are none.
    pub fn describe(&self, demand: &Demand, timeouts: &Timeouts) -> Option<String> {
        let mut lines: BTreeMap<u64, String> = self
            .unfit
            .iter()
            .map(|(id, reason)| (*id, format!("server {id}: {reason}")))
            .collect();
        for (id, slot) in &self.slots {
            let answer = match self.health.failures(*id) {
                Some((1, failure)) => format!("fits, but failed: {failure}"),
                Some((times, failure)) => format!(
                    "fits, but failed {times} times in a row, the last time because: {failure}"
                ),
                None if slot.silent => {
                    format!("fits, but is silent; {}", timeouts.step_hint())
                }
                None => "fits".to_owned(),
            };
            lines.insert(*id, format!("server {id}: {answer}"));
        }
        for (id, presence) in &self.presences {
            let misfit = self.misfit(demand, &presence.simulations, &presence.capabilities);
            if misfit.is_none() && presence.state == State::Ready && self.unmatched.contains_key(id)
            {
                // The server's answer to the discovery is more informative.
                continue;
            }
            let state = match (presence.state, &presence.tool) {
                // The time in a last will is that of the connection, not of the loss.
                (State::Lost, _) => "lost".to_owned(),
                (State::Busy, Some(tool)) => format!("fits, but is busy for {tool}"),
                (State::Busy, None) => "fits, but is busy".to_owned(),
                (State::Ready, _) => "fits, but does not answer".to_owned(),
            };
            lines
                .entry(*id)
                .or_insert_with(|| format!("server {id}: {}", misfit.unwrap_or(state)));
        }
        for (id, hash) in &self.unmatched {
            lines.entry(*id).or_insert_with(|| {
                format!(
                    "server {id} answers with simulation_hash {hash:?}, which belongs to no discovery of this tool; unless it \
                     answered another tool, make it return the hash of the discovery"
                )
            });
        }
        let mut lines: Vec<String> = lines.into_values().collect();
        lines.extend(self.unreadable.as_ref().map(|reason| {
            format!("an answer to a discovery on the topic server, which was refused: {reason}")
        }));
        (!lines.is_empty()).then(|| lines.join("; "))
    }

    /// Returns whether there is any other server.
    pub fn has_other(&self, server: u64) -> bool {
        self.slots().any(|(id, _)| id != server)
    }

    /// Describes for users where the failed work of this server is retried.
    pub fn describe_retry(&self, server: u64) -> &'static str {
        if self.has_other(server) {
            " elsewhere"
        } else {
            "; there is no other server"
        }
    }

    /// Returns the metrics that servers announce, sorted, to suggest corrections of misspelt names.
    pub fn metrics(&self) -> Vec<String> {
        let mut names: Vec<String> = self.metrics.values().flatten().cloned().collect();
        names.sort();
        names.dedup();
        names
    }

    /// Returns the sides that each server announces, by id.
    pub fn sides(&self) -> Vec<(u64, &[AnnouncedSide])> {
        let sides = self.sides.iter();
        sides.map(|(id, sides)| (*id, sides.as_slice())).collect()
    }

    /// Returns the titles that servers offer, sorted, to suggest corrections of misspelt names.
    pub fn titles(&self) -> Vec<String> {
        let mut titles: Vec<String> = self
            .presences
            .values()
            .flat_map(|presence| presence.simulations.clone())
            .collect();
        titles.sort();
        titles.dedup();
        titles
    }
}
