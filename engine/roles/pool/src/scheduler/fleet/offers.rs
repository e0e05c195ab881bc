//! Offers of servers: discovery answers, presence, and duplicates.

use std::time::Instant;

use swarmwright_protocol::{Capabilities, DecodeError, Presence, ServerMessage, State, shortened};

use crate::demand::Demand;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::lag::Answers;
use crate::scheduler::fleet::pace::Pace;
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::job::Job;

/// Work that a server will not finish.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Ended {
    pub server: u64,
    pub jobs: Vec<Job>,
    pub reason: String,
    /// Whether the server itself failed.
    pub server_fault: bool,
}

/// Outcome of an answer to a discovery.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// The server may be used.
    Welcome,
    /// The server is already known.
    Known,
    /// The server does not fit; with the reason, if it is new.
    Unfit(Option<String>),
    /// Two servers share the id; the jobs to give up, and whether this was unknown before.
    Duplicate(Vec<Job>, bool),
}

/// Largest number of remembered servers that answered with other hashes.
const MOST_UNMATCHED: usize = 100;
/// Largest number of characters of a hash in messages.
const MOST_HASH: usize = 80;

const DUPLICATE: &str =
    "two servers answer to this id, so neither is used; give one of them another --id";

impl Fleet {
    pub fn answered(
        &mut self,
        message: ServerMessage,
        round: u64,
        demand: &Demand,
        now: Instant,
    ) -> Answer {
        let id = message.server;
        self.unmatched.remove(&id);
        self.announced(id, &message.capabilities);
        if message.simulations.contains(&demand.simulation) {
            let announced = message.capabilities.swarmwright.as_ref();
            let names = announced.map(|announced| announced.metrics.clone());
            let sides = announced.map(|announced| announced.sides.clone());
            self.metrics.insert(id, names.unwrap_or_default());
            self.sides.insert(id, sides.unwrap_or_default());
        }
        let distrusted = self.health.distrusted(id).map(str::to_owned);
        let misfit = || self.misfit(demand, &message.simulations, &message.capabilities);
        if let Some(reason) = distrusted.or_else(misfit) {
            let news = self.unfit.insert(id, reason.clone()).as_ref() != Some(&reason);
            return Answer::Unfit(news.then_some(reason));
        }
        let Ok(way) = demand.way(&message.capabilities) else {
            return Answer::Unfit(None);
        };
        let instance = message
            .capabilities
            .swarmwright
            .as_ref()
            .and_then(|announced| announced.instance.clone());
        if self.is_lost(id, instance.as_deref()) {
            return Answer::Unfit(None);
        }
        let rival = self.has_rival(id, instance.as_ref(), round);
        if self.still_duplicate(id, round) || (rival && !self.slots.contains_key(&id)) {
            return Answer::Duplicate(Vec::new(), false);
        }
        if self
            .refusals
            .get(&id)
            .is_some_and(|(refused, _)| *refused == instance)
        {
            return Answer::Unfit(None);
        }
        if let Some(slot) = self.slots.get_mut(&id) {
            // A server answers a round once; a second answer comes from a second server unless it names the same
            // instance.
            let same = instance.is_some() && slot.instance == instance;
            if (slot.round == round && !same) || rival {
                let (jobs, news) = self.are_two(id, round);
                return Answer::Duplicate(jobs, news);
            }
            slot.round = slot.round.max(round);
            if slot.instance == instance {
                slot.capabilities = message.capabilities;
                slot.silent = false;
                slot.heard = now;
                return Answer::Known;
            }
            // The server was restarted under its old id.
            if !slot.jobs.is_empty() {
                return Answer::Known;
            }
        }
        self.unfit.remove(&id);
        self.refusals.remove(&id);
        self.note_sizes(id, &message.capabilities);
        self.health.note_instance(id, instance.as_deref());
        self.slots.insert(
            id,
            Slot {
                way,
                jobs: Vec::new(),
                backs_off_until: None,
                suspended: false,
                heard: now,
                answered_at: now,
                overtaken: None,
                longest: 0.0,
                rate: None,
                held: false,
                instance,
                capabilities: message.capabilities,
                silent: false,
                steps: Pace::default(),
                episodes: Pace::default(),
                answers: Answers::default(),
                preempted: 0,
                passed_over: None,
                round,
                last_hash: None,
            },
        );
        Answer::Welcome
    }

    /// Records the capabilities from an answer to a discovery; presence may be retained and belong to an earlier
    /// instance.
    fn announced(&mut self, id: u64, capabilities: &Capabilities) {
        let announced = capabilities.swarmwright.as_ref();
        if announced.is_some_and(|announced| announced.control) {
            self.on_own_topic.insert(id);
        } else {
            self.on_own_topic.remove(&id);
        }
    }

    /// Returns whether a server receives control messages on its own topic. If two servers share an id, only one of
    /// them may listen there.
    pub fn hears_own_topic(&self, id: u64) -> bool {
        self.on_own_topic.contains(&id) && !self.duplicates.contains_key(&id)
    }

    /// Excludes an id that two servers share, as a round has shown, until only one is left. Returns their jobs, and
    /// whether this was unknown before.
    pub fn are_two(&mut self, id: u64, round: u64) -> (Vec<Job>, bool) {
        let before = self.unfit.insert(id, DUPLICATE.to_owned());
        self.duplicates.insert(id, (round, 2));
        (
            self.remove(id),
            before.is_none_or(|reason| reason != DUPLICATE),
        )
    }

    /// Records an answer with a hash that is not of this tool's discoveries. Most belong to another tool, but a server
    /// that implements D6.1 only may always send one, because section 7.2.2 can be read as requiring a fixed answer.
    pub fn answered_other_discovery(&mut self, message: ServerMessage, demand: &Demand) {
        let few = self.unmatched.len() < MOST_UNMATCHED;
        if few && message.simulations.contains(&demand.simulation) {
            let hash = shortened(message.simulation_hash, MOST_HASH);
            self.unmatched.insert(message.server, hash);
        }
    }

    /// Records that an answer to a discovery, perhaps of this tool, could not be read.
    pub fn refused_answer(&mut self, error: &DecodeError) {
        self.unreadable = Some(error.to_string());
    }

    /// Returns whether an instance of a server is known to be gone, so that its answer is outdated or a duplicate.
    fn is_lost(&self, id: u64, instance: Option<&str>) -> bool {
        let lost = |presence: &&Presence| presence.state == State::Lost;
        let presence = self.presences.get(&id).filter(lost);
        let announced = presence.and_then(|presence| presence.capabilities.swarmwright.as_ref());
        let gone = announced.and_then(|announced| announced.instance.as_deref());
        gone.is_some() && gone == instance
    }

    /// Returns whether another instance answered under this id in this round or the two before, and has not left since.
    /// Two answers to the same round are not the only sign of a duplicate, since answers to several rounds may cross.
    fn has_rival(&mut self, id: u64, instance: Option<&String>, round: u64) -> bool {
        let Some(instance) = instance else {
            return false;
        };
        let instances = self.seen.entry(id).or_default();
        instances.retain(|(other, last)| other != instance && last + 2 >= round);
        let rival = !instances.is_empty();
        instances.push((instance.clone(), round));
        rival
    }

    /// Returns whether an id may still be shared: it is used again once only one answer came in a whole round.
    fn still_duplicate(&mut self, id: u64, round: u64) -> bool {
        let Some((last, count)) = self.duplicates.get_mut(&id) else {
            return false;
        };
        if round <= *last {
            // Late answers to an older round prove nothing.
            *count += u32::from(round == *last);
            return true;
        }
        let alone = *count == 1;
        (*last, *count) = (round, 1);
        if alone {
            self.duplicates.remove(&id);
        }
        !alone
    }

    /// Reassigns the modes of all servers after the kind of the controllers became known or changed. Returns the
    /// servers that do not fit any more, with the reason.
    pub fn assign(&mut self, demand: &Demand) -> Vec<(u64, String)> {
        self.refusals.clear();
        let mut unfit = Vec::new();
        self.slots
            .retain(|id, slot| match demand.way(&slot.capabilities) {
                Ok(way) => {
                    if slot.way != way {
                        slot.rate = None;
                    }
                    slot.way = way;
                    true
                }
                Err(reason) => {
                    unfit.push((*id, reason));
                    false
                }
            });
        self.unfit.extend(unfit.iter().cloned());
        unfit
    }

    /// Excludes a server that refuses the current work. Returns its jobs.
    pub fn refuse(&mut self, id: u64, reason: &str) -> Vec<Job> {
        if let Some(slot) = self.slots.get(&id) {
            let refusal = (slot.instance.clone(), reason.to_owned());
            self.refusals.insert(id, refusal);
        }
        self.unfit.insert(id, format!("refuses the work: {reason}"));
        self.remove(id)
    }

    /// Returns why no server does the work, if the only servers are those that refused it.
    pub fn refused(&self) -> Option<String> {
        let lines: Vec<String> = self
            .refusals
            .iter()
            .map(|(id, (_, reason))| format!("server {id}: {reason}"))
            .collect();
        (self.slots.is_empty() && !lines.is_empty()).then(|| lines.join("; "))
    }

    /// Records a change of presence. Returns the work that it ends, and whether to start a discovery.
    pub fn present(&mut self, presence: Presence, tool: &str) -> (Option<Ended>, bool) {
        let id = presence.server;
        let announced = presence
            .capabilities
            .swarmwright
            .as_ref()
            .and_then(|announced| announced.instance.clone());
        let state = presence.state;
        let elsewhere = state == State::Busy && presence.tool.as_deref() != Some(tool);
        let unnamed = presence.tool.is_none();
        let holder = presence
            .tool
            .clone()
            .unwrap_or_else(|| "another optimization tool".to_owned());
        if state == State::Lost
            && let (Some(instances), Some(announced)) = (self.seen.get_mut(&id), &announced)
        {
            instances.retain(|(instance, _)| instance != announced);
        }
        self.presences.insert(id, presence);
        if state == State::Lost {
            self.health.process_ended(id);
        }
        if state == State::Lost || elsewhere {
            self.left_behind.remove(id);
        }
        let Some(slot) = self
            .slots
            .get(&id)
            .filter(|slot| slot.instance.is_none() || slot.instance == announced)
        else {
            // A server that waits for this tool because it is its turn is as good as a free one.
            return (
                None,
                state == State::Ready || (state == State::Busy && !elsewhere),
            );
        };
        let ended = |jobs: Vec<Job>, reason: String, server_fault: bool| {
            let ended = Ended {
                server: id,
                jobs,
                reason,
                server_fault,
            };
            (Some(ended), false)
        };
        match state {
            // Whether it has begun its episode is learnt from its answer to a discovery.
            State::Ready => {
                let is_episode = |job: &Job| matches!(job, Job::Episode(_));
                (None, slot.jobs.iter().all(is_episode))
            }
            State::Lost => ended(self.remove(id), format!("server {id} was lost"), true),
            State::Busy if elsewhere && slot.jobs.is_empty() && slot.usable() => {
                self.slots.remove(&id);
                (None, false)
            }
            // The busy server does not name its tool; it may be this one, if the parameters arrived before `control`.
            State::Busy if elsewhere && unnamed => (None, false),
            State::Busy if elsewhere => {
                // Requests are answered whichever tool holds the server, but steps would never arrive.
                let is_episode = |job: &Job| matches!(job, Job::Episode(_));
                let jobs = slot.jobs.iter().filter(|job| is_episode(job));
                let jobs = jobs.cloned().collect();
                ended(jobs, format!("server {id} is taken by {holder}"), false)
            }
            State::Busy => (None, false),
        }
    }

    /// Removes a server that left in an orderly way. Returns its jobs.
    pub fn on_leave(&mut self, id: u64) -> Vec<Job> {
        self.presences.remove(&id);
        self.health.process_ended(id);
        self.left_behind.remove(id);
        self.on_own_topic.remove(&id);
        self.unfit.remove(&id);
        self.unmatched.remove(&id);
        self.metrics.remove(&id);
        self.sides.remove(&id);
        self.seen.remove(&id);
        self.remove(id)
    }
}
