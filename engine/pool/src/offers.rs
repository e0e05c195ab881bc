//! Which servers there are, what each offers, and why one does not fit.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use swarmwright_protocol::{Capabilities, Presence, Requirements, ServerMessage, State};

/// What the experiment needs of a server.
#[derive(Debug, Clone, PartialEq)]
pub struct Demand {
    /// Title of the simulation.
    pub simulation: String,
    /// Dimensions and agents.
    pub requirements: Requirements,
    /// Numbers in a sensor message, if known.
    pub sensors: Option<usize>,
    /// Numbers in an actuator message, if known.
    pub actuators: Option<usize>,
}

impl Demand {
    /// Why a server does not fit; none if it does.
    #[must_use]
    pub fn misfit(&self, simulations: &[String], capabilities: &Capabilities) -> Option<String> {
        if !simulations.contains(&self.simulation) {
            return Some(format!(
                "offers {}, not {}",
                simulations.join(", "),
                self.simulation
            ));
        }
        if !capabilities.fulfil(&self.requirements) {
            let agents = capabilities.max_agents.map_or_else(String::new, |agents| {
                format!(" and at most {agents} agents")
            });
            return Some(format!(
                "has {} dimensions{agents}",
                capabilities.dimensions
            ));
        }
        let announced = capabilities.swarmwright.as_ref();
        let differs =
            |what: &str, wanted: Option<usize>, found: Option<usize>| match (wanted, found) {
                (Some(wanted), Some(found)) if wanted != found => Some(format!(
                    "announces {found} {what}, but the experiment says {wanted}"
                )),
                _ => None,
            };
        differs("sensors", self.sensors, announced.and_then(|a| a.sensors)).or_else(|| {
            differs(
                "actuators",
                self.actuators,
                announced.and_then(|a| a.actuators),
            )
        })
    }

    /// The demand in words.
    #[must_use]
    pub fn describe(&self) -> String {
        let agents = self
            .requirements
            .max_agents
            .map_or_else(String::new, |agents| format!(", at least {agents} agents"));
        let counts = match (self.sensors, self.actuators) {
            (Some(sensors), Some(actuators)) => {
                format!(", {sensors} sensors, {actuators} actuators")
            }
            _ => String::new(),
        };
        format!(
            "simulation {}, {} dimensions{agents}{counts}",
            self.simulation, self.requirements.dimensions
        )
    }
}

/// What a server does for this tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Duty {
    /// It answered a discovery and fits.
    Idle,
    /// It runs the episode of this hash.
    Running(String),
    /// It failed; not before this time again.
    Benched(Instant),
}

#[derive(Debug, Clone)]
pub(crate) struct Slot {
    pub duty: Duty,
    pub instance: Option<String>,
    pub capabilities: Capabilities,
    /// Failures in a row, and why it failed last.
    pub failures: u32,
    failure: String,
    /// The last round of discovery that it answered.
    round: u64,
    /// Last hash that it ran for this tool.
    pub last_hash: Option<String>,
}

/// All that is known of servers.
#[derive(Debug, Default)]
pub struct Offers {
    pub(crate) slots: BTreeMap<u64, Slot>,
    presences: BTreeMap<u64, Presence>,
    /// Servers that answered and do not fit, or cannot be told apart.
    unfit: BTreeMap<u64, String>,
    /// Ids to which two servers answered: the last round in which one did, and how often.
    twins: BTreeMap<u64, (u64, u32)>,
}

/// What an answer to discovery means.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// The server may be used.
    Welcome,
    /// Known already.
    Known,
    /// It does not fit; why, if that is news.
    Unfit(Option<String>),
    /// Two servers answer to one id; the hash of the run to be given up, and whether that is news.
    Twins(Option<String>, bool),
}

const TWINS: &str =
    "two servers answer to this id, so neither is used; give one of them another --id";
const FIRST_BENCH: Duration = Duration::from_secs(1);
const LONGEST_BENCH: Duration = Duration::from_secs(60);

impl Offers {
    /// Forgets everything: the connection broke.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    pub(crate) fn answered(
        &mut self,
        message: ServerMessage,
        round: u64,
        demand: &Demand,
    ) -> Answer {
        let id = message.server;
        if let Some(reason) = demand.misfit(&message.simulations, &message.capabilities) {
            let news = self.unfit.insert(id, reason.clone()).as_ref() != Some(&reason);
            return Answer::Unfit(news.then_some(reason));
        }
        if self.still_twins(id, round) {
            return Answer::Twins(None, false);
        }
        let instance = message
            .capabilities
            .swarmwright
            .as_ref()
            .and_then(|announced| announced.instance.clone());
        if let Some(slot) = self.slots.get_mut(&id) {
            // A server answers a round once; a second answer comes from a second server.
            if slot.round == round {
                let news = self
                    .unfit
                    .insert(id, TWINS.to_owned())
                    .is_none_or(|reason| reason != TWINS);
                self.twins.insert(id, (round, 2));
                return Answer::Twins(self.remove(id), news);
            }
            slot.round = slot.round.max(round);
            if slot.instance == instance {
                slot.capabilities = message.capabilities;
                return Answer::Known;
            }
            // Started anew under its old id.
            if matches!(slot.duty, Duty::Running(_)) {
                return Answer::Known;
            }
        }
        self.unfit.remove(&id);
        let (failures, failure) = self.slots.get(&id).map_or((0, String::new()), |slot| {
            (slot.failures, slot.failure.clone())
        });
        self.slots.insert(
            id,
            Slot {
                duty: Duty::Idle,
                instance,
                capabilities: message.capabilities,
                failures,
                failure,
                round,
                last_hash: None,
            },
        );
        Answer::Welcome
    }

    /// Whether an id that two servers had is still in doubt: it is used again when only one answer came in a whole round.
    fn still_twins(&mut self, id: u64, round: u64) -> bool {
        let Some((last, count)) = self.twins.get_mut(&id) else {
            return false;
        };
        if *last == round {
            *count += 1;
            return true;
        }
        let alone = *count == 1;
        (*last, *count) = (round, 1);
        if alone {
            self.twins.remove(&id);
        }
        !alone
    }

    /// A server's presence changed. Returns the hash of the run that this ends, with the reason and whether it was the
    /// server's own failure; and whether a discovery is worth it.
    pub(crate) fn present(
        &mut self,
        presence: Presence,
        tool: &str,
    ) -> (Option<(String, String, bool)>, bool) {
        let id = presence.server;
        let announced = presence
            .capabilities
            .swarmwright
            .as_ref()
            .and_then(|announced| announced.instance.clone());
        let same = self
            .slots
            .get(&id)
            .is_some_and(|slot| slot.instance.is_none() || slot.instance == announced);
        let state = presence.state;
        let elsewhere = state == State::Busy && presence.tool.as_deref() != Some(tool);
        let holder = presence
            .tool
            .clone()
            .unwrap_or_else(|| "another optimization tool".to_owned());
        self.presences.insert(id, presence);
        if !same {
            return (None, state == State::Ready);
        }
        match state {
            State::Ready => (
                None,
                self.slots
                    .get(&id)
                    .is_none_or(|slot| !matches!(slot.duty, Duty::Running(_))),
            ),
            State::Lost => (
                self.remove(id)
                    .map(|hash| (hash, format!("server {id} was lost"), true)),
                false,
            ),
            State::Busy if elsewhere => match self.slots.get(&id).map(|slot| slot.duty.clone()) {
                Some(Duty::Running(hash)) => (
                    Some((hash, format!("server {id} is taken by {holder}"), false)),
                    false,
                ),
                Some(Duty::Idle) => {
                    self.slots.remove(&id);
                    (None, false)
                }
                _ => (None, false),
            },
            State::Busy => (None, false),
        }
    }

    /// A server left in good order. Returns the hash of the run that this ends.
    pub(crate) fn left(&mut self, id: u64) -> Option<String> {
        self.presences.remove(&id);
        self.unfit.remove(&id);
        self.remove(id)
    }

    pub(crate) fn remove(&mut self, id: u64) -> Option<String> {
        match self.slots.remove(&id)?.duty {
            Duty::Running(hash) => Some(hash),
            _ => None,
        }
    }

    /// A server failed an episode: a pause that doubles with each failure in a row.
    pub(crate) fn bench(&mut self, id: u64, reason: &str, now: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.failures += 1;
            reason.clone_into(&mut slot.failure);
            let pause = FIRST_BENCH * 2u32.saturating_pow((slot.failures - 1).min(6));
            slot.duty = Duty::Benched(now + pause.min(LONGEST_BENCH));
        }
    }

    /// Benched servers whose pause is over may be used again.
    pub(crate) fn unbench(&mut self, now: Instant) {
        for slot in self.slots.values_mut() {
            if matches!(slot.duty, Duty::Benched(until) if until <= now) {
                slot.duty = Duty::Idle;
            }
        }
    }

    pub(crate) fn next_unbench(&self) -> Option<Instant> {
        self.slots
            .values()
            .filter_map(|slot| match slot.duty {
                Duty::Benched(until) => Some(until),
                _ => None,
            })
            .min()
    }

    /// Numbers of sensors and actuators that a fitting server announces.
    pub(crate) fn sizes(&self) -> Option<(usize, usize)> {
        self.slots.values().find_map(|slot| {
            let announced = slot.capabilities.swarmwright.as_ref()?;
            Some((announced.sensors?, announced.actuators?))
        })
    }

    /// Whether a server that fits is there but serves somebody else.
    pub(crate) fn busy_elsewhere(&self, demand: &Demand) -> Option<String> {
        self.presences
            .values()
            .find(|presence| {
                presence.state == State::Busy
                    && demand
                        .misfit(&presence.simulations, &presence.capabilities)
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

    /// What was found, a line per server.
    pub(crate) fn describe(&self, demand: &Demand) -> String {
        let mut lines: BTreeMap<u64, String> = self
            .unfit
            .iter()
            .map(|(id, reason)| (*id, format!("server {id}: {reason}")))
            .collect();
        for (id, slot) in &self.slots {
            let answer = if slot.failures == 0 {
                "fits".to_owned()
            } else {
                let (times, failure) = (slot.failures, &slot.failure);
                format!("fits, but failed {times} times in a row, the last time because: {failure}")
            };
            lines.insert(*id, format!("server {id}: {answer}"));
        }
        for (id, presence) in &self.presences {
            let misfit = demand.misfit(&presence.simulations, &presence.capabilities);
            let state = match (presence.state, &presence.tool) {
                (State::Lost, _) => format!("lost since {}", presence.since),
                (State::Busy, Some(tool)) => format!("fits, but is busy for {tool}"),
                (State::Busy, None) => "fits, but is busy".to_owned(),
                (State::Ready, _) => "fits, but does not answer".to_owned(),
            };
            lines
                .entry(*id)
                .or_insert_with(|| format!("server {id}: {}", misfit.unwrap_or(state)));
        }
        if lines.is_empty() {
            "no server at all; start one with `swarmwright serve`".to_owned()
        } else {
            lines.into_values().collect::<Vec<_>>().join("; ")
        }
    }

    /// Titles that servers offer, for a hint at a misspelling.
    pub(crate) fn titles(&self) -> Vec<String> {
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
