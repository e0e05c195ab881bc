//! Which servers there are, and what each offers.

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
    /// Whether it was the server's own failure.
    pub server_fault: bool,
}

/// What an answer to discovery means.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// The server may be used.
    Welcome,
    /// Known already.
    Known,
    /// It does not fit; with the reason, if it is new.
    Unfit(Option<String>),
    /// Two servers answer to one id; the jobs to be given up, and whether that is news.
    Duplicate(Vec<Job>, bool),
}

/// Servers with other hashes that are remembered.
const MOST_UNMATCHED: usize = 100;
/// Characters of a hash that are shown, at most.
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
            self.metrics.insert(id, names.unwrap_or_default());
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
            // A server answers a round once; a second answer comes from a second server, unless it says that it does not.
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
            // Started anew under its old id.
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

    /// What a server says in its answer; presence may be retained, and of another start of it.
    fn announced(&mut self, id: u64, capabilities: &Capabilities) {
        let announced = capabilities.swarmwright.as_ref();
        if announced.is_some_and(|announced| announced.control) {
            self.on_own_topic.insert(id);
        } else {
            self.on_own_topic.remove(&id);
        }
    }

    /// Whether a server gets control messages on its own topic. Of two with one id another one may not listen there.
    pub fn hears_own_topic(&self, id: u64) -> bool {
        self.on_own_topic.contains(&id) && !self.duplicates.contains_key(&id)
    }

    /// Two servers have an id, as was seen in a round: it is not used until one is left. Returns the jobs that they had,
    /// and whether that is news.
    pub fn are_two(&mut self, id: u64, round: u64) -> (Vec<Job>, bool) {
        let before = self.unfit.insert(id, DUPLICATE.to_owned());
        self.duplicates.insert(id, (round, 2));
        (
            self.remove(id),
            before.is_none_or(|reason| reason != DUPLICATE),
        )
    }

    /// A server answered with a hash that this tool has not asked with: another tool's, mostly. One that knows D6.1 alone
    /// may do so always, for section 7.2.2 can be read so that its answer is fixed.
    pub fn answered_other_discovery(&mut self, message: ServerMessage, demand: &Demand) {
        let few = self.unmatched.len() < MOST_UNMATCHED;
        if few && message.simulations.contains(&demand.simulation) {
            let hash = shortened(message.simulation_hash, MOST_HASH);
            self.unmatched.insert(message.server, hash);
        }
    }

    /// An answer to a discovery, perhaps this tool's, could not be read.
    pub fn refused_answer(&mut self, error: &DecodeError) {
        self.unreadable = Some(error.to_string());
    }

    /// Whether a start of a server is known to be gone: its answer is older, or came twice.
    fn is_lost(&self, id: u64, instance: Option<&str>) -> bool {
        let lost = |presence: &&Presence| presence.state == State::Lost;
        let presence = self.presences.get(&id).filter(lost);
        let announced = presence.and_then(|presence| presence.capabilities.swarmwright.as_ref());
        let gone = announced.and_then(|announced| announced.instance.as_deref());
        gone.is_some() && gone == instance
    }

    /// Whether another instance answered under this id in this round or one of the two before, and did not leave since:
    /// answers to several rounds may cross, so that the same round is not all that tells duplicates.
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

    /// Whether an id that two servers had is still in doubt: it is used again when only one answer came in a whole round.
    fn still_duplicate(&mut self, id: u64, round: u64) -> bool {
        let Some((last, count)) = self.duplicates.get_mut(&id) else {
            return false;
        };
        if round <= *last {
            // Answers to an older round may come late and tell nothing.
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

    /// The kind of the controllers is known now, or has changed: what each server is used for. Returns those that do
    /// not fit any more, with the reason.
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

    /// A server says that this work cannot be done by it. Returns the jobs that it had.
    pub fn refuse(&mut self, id: u64, reason: &str) -> Vec<Job> {
        if let Some(slot) = self.slots.get(&id) {
            let refusal = (slot.instance.clone(), reason.to_owned());
            self.refusals.insert(id, refusal);
        }
        self.unfit.insert(id, format!("refuses the work: {reason}"));
        self.remove(id)
    }

    /// Why no server does the work, if there is none but those that refused it.
    pub fn refused(&self) -> Option<String> {
        let lines: Vec<String> = self
            .refusals
            .iter()
            .map(|(id, (_, reason))| format!("server {id}: {reason}"))
            .collect();
        (self.slots.is_empty() && !lines.is_empty()).then(|| lines.join("; "))
    }

    /// A server's presence changed. Returns the work that this ends, and whether a discovery is worth it.
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
            // A server that waits for this tool, since it is its turn, is as good as a free one.
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
            // What it says to an episode that it may not have begun is learnt from its answer to a question.
            State::Ready => {
                let is_episode = |job: &Job| matches!(job, Job::Episode(_));
                (None, slot.jobs.iter().all(is_episode))
            }
            State::Lost => ended(self.remove(id), format!("server {id} was lost"), true),
            State::Busy if elsewhere && slot.jobs.is_empty() && slot.usable() => {
                self.slots.remove(&id);
                (None, false)
            }
            // Which tool has it is not said: perhaps this one, whose parameters came, and whose `control` has not yet.
            State::Busy if elsewhere && unnamed => (None, false),
            State::Busy if elsewhere => {
                // Requests are answered whichever tool has the server; steps would be waited for in vain.
                let is_episode = |job: &Job| matches!(job, Job::Episode(_));
                let jobs = slot.jobs.iter().filter(|job| is_episode(job));
                let jobs = jobs.cloned().collect();
                ended(jobs, format!("server {id} is taken by {holder}"), false)
            }
            State::Busy => (None, false),
        }
    }

    /// A server left in good order. Returns the jobs that it had.
    pub fn on_leave(&mut self, id: u64) -> Vec<Job> {
        self.presences.remove(&id);
        self.health.process_ended(id);
        self.left_behind.remove(id);
        self.on_own_topic.remove(&id);
        self.unfit.remove(&id);
        self.unmatched.remove(&id);
        self.metrics.remove(&id);
        self.seen.remove(&id);
        self.remove(id)
    }
}
