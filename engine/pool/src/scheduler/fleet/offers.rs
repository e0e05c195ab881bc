//! Which servers there are, and what each offers.

use std::collections::BTreeMap;
use std::time::Instant;

use swarmwright_protocol::{Presence, ServerMessage, State, shortened};

use crate::demand::Demand;
use crate::scheduler::fleet::health::Health;
use crate::scheduler::fleet::lag::Answers;
use crate::scheduler::fleet::pace::Pace;
use crate::scheduler::fleet::slot::{Job, Slot};

/// All that is known of servers.
#[derive(Debug, Default)]
pub struct Offers {
    pub(crate) slots: BTreeMap<u64, Slot>,
    presences: BTreeMap<u64, Presence>,
    /// Servers that answered and do not fit, or cannot be told apart.
    unfit: BTreeMap<u64, String>,
    /// By id: the instances that answered lately, each with its last round.
    seen: BTreeMap<u64, Vec<(String, u64)>>,
    /// Ids to which two servers answered: the last round in which one did, and how often.
    twins: BTreeMap<u64, (u64, u32)>,
    /// Servers that answered with a hash that this tool has not asked with, each with that hash.
    strangers: BTreeMap<u64, String>,
    /// Servers that refused this work as such, by id: which start of the server, and why.
    refusals: BTreeMap<u64, (Option<String>, String)>,
    /// How ids have behaved so far.
    pub(crate) health: Health,
    /// Metrics that servers announced for this simulation, by id, whether they fit or not.
    metrics: BTreeMap<u64, Vec<String>>,
}

/// Work that a server will not finish.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Ended {
    pub server: u64,
    pub jobs: Vec<Job>,
    pub reason: String,
    /// Whether it was the server's own failure.
    pub own_fault: bool,
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
    /// Two servers answer to one id; the jobs to be given up, and whether that is news.
    Twins(Vec<Job>, bool),
}

/// Servers with other hashes that are remembered.
const MOST_STRANGERS: usize = 100;
/// Characters of a hash that are shown, at most.
const MOST_HASH: usize = 80;

const TWINS: &str =
    "two servers answer to this id, so neither is used; give one of them another --id";

impl Offers {
    /// Forgets who is there: the connection broke.
    pub(crate) fn clear(&mut self) {
        *self = Self {
            health: std::mem::take(&mut self.health),
            ..Self::default()
        };
    }

    pub(crate) fn answered(
        &mut self,
        message: ServerMessage,
        round: u64,
        demand: &Demand,
        now: Instant,
    ) -> Answer {
        let id = message.server;
        if message.simulations.contains(&demand.simulation) {
            let announced = message.capabilities.swarmwright.as_ref();
            let names = announced.map(|announced| announced.metrics.clone());
            self.metrics.insert(id, names.unwrap_or_default());
        }
        let distrusted = self.health.distrusted(id).map(str::to_owned);
        let misfit = || demand.misfit(&message.simulations, &message.capabilities);
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
        if self.still_twins(id, round) || (rival && !self.slots.contains_key(&id)) {
            return Answer::Twins(Vec::new(), false);
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
                return Answer::Twins(jobs, news);
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
        self.slots.insert(
            id,
            Slot {
                way,
                jobs: Vec::new(),
                benched: None,
                suspended: false,
                heard: now,
                rate: None,
                held: false,
                instance,
                capabilities: message.capabilities,
                silent: false,
                steps: Pace::default(),
                episodes: Pace::default(),
                answers: Answers::default(),
                beaten: 0,
                passed_over: None,
                round,
                last_hash: None,
            },
        );
        Answer::Welcome
    }

    /// Two servers have an id, as was seen in a round: it is not used until one is left. Returns the jobs that they had,
    /// and whether that is news.
    pub(crate) fn are_two(&mut self, id: u64, round: u64) -> (Vec<Job>, bool) {
        let before = self.unfit.insert(id, TWINS.to_owned());
        self.twins.insert(id, (round, 2));
        (self.remove(id), before.is_none_or(|reason| reason != TWINS))
    }

    /// A server answered with a hash that this tool has not asked with: another tool's, mostly. One that knows D6.1 alone
    /// may do so always, for section 7.2.2 can be read so that its answer is fixed.
    pub(crate) fn answered_another(&mut self, message: ServerMessage, demand: &Demand) {
        let announced = message.capabilities.swarmwright.is_some();
        let few = self.strangers.len() < MOST_STRANGERS;
        if few && !announced && message.simulations.contains(&demand.simulation) {
            let hash = shortened(message.simulation_hash, MOST_HASH);
            self.strangers.insert(message.server, hash);
        }
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
    /// answers to several rounds may cross, so that the same round is not all that tells twins.
    fn has_rival(&mut self, id: u64, instance: Option<&String>, round: u64) -> bool {
        let Some(instance) = instance else {
            return false;
        };
        let seen = self.seen.entry(id).or_default();
        seen.retain(|(other, last)| other != instance && last + 2 >= round);
        let rival = !seen.is_empty();
        seen.push((instance.clone(), round));
        rival
    }

    /// Whether an id that two servers had is still in doubt: it is used again when only one answer came in a whole round.
    fn still_twins(&mut self, id: u64, round: u64) -> bool {
        let Some((last, count)) = self.twins.get_mut(&id) else {
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
            self.twins.remove(&id);
        }
        !alone
    }

    /// The kind of the controllers is known now, or has changed: what each server is used for. Returns those that do
    /// not fit any more, with the reason.
    pub(crate) fn assign(&mut self, demand: &Demand) -> Vec<(u64, String)> {
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
    pub(crate) fn refuse(&mut self, id: u64, reason: &str) -> Vec<Job> {
        if let Some(slot) = self.slots.get(&id) {
            let refusal = (slot.instance.clone(), reason.to_owned());
            self.refusals.insert(id, refusal);
        }
        self.unfit.insert(id, format!("refuses the work: {reason}"));
        self.remove(id)
    }

    /// Why no server does the work, if there is none but those that refused it.
    pub(crate) fn refused(&self) -> Option<String> {
        let lines: Vec<String> = self
            .refusals
            .iter()
            .map(|(id, (_, reason))| format!("server {id}: {reason}"))
            .collect();
        (self.slots.is_empty() && !lines.is_empty()).then(|| lines.join("; "))
    }

    /// A server's presence changed. Returns the work that this ends, and whether a discovery is worth it.
    pub(crate) fn present(&mut self, presence: Presence, tool: &str) -> (Option<Ended>, bool) {
        let id = presence.server;
        let announced = presence
            .capabilities
            .swarmwright
            .as_ref()
            .and_then(|announced| announced.instance.clone());
        let state = presence.state;
        let elsewhere = state == State::Busy && presence.tool.as_deref() != Some(tool);
        let holder = presence
            .tool
            .clone()
            .unwrap_or_else(|| "another optimization tool".to_owned());
        if state == State::Lost
            && let (Some(seen), Some(announced)) = (self.seen.get_mut(&id), &announced)
        {
            seen.retain(|(instance, _)| instance != announced);
        }
        self.presences.insert(id, presence);
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
        let ended = |jobs: Vec<Job>, reason: String, own_fault: bool| {
            let ended = Ended {
                server: id,
                jobs,
                reason,
                own_fault,
            };
            (Some(ended), false)
        };
        match state {
            // What it says to an episode that it may not have begun is learnt from its answer to a question.
            State::Ready => {
                let asked = |job: &Job| matches!(job, Job::Episode(_));
                (None, slot.jobs.iter().all(asked))
            }
            State::Lost => ended(self.remove(id), format!("server {id} was lost"), true),
            State::Busy if elsewhere && slot.jobs.is_empty() && slot.usable() => {
                self.slots.remove(&id);
                (None, false)
            }
            State::Busy if elsewhere => {
                // Requests are answered by whoever has the server; steps would be waited for in vain.
                let is_episode = |job: &Job| matches!(job, Job::Episode(_));
                let jobs = slot.jobs.iter().filter(|job| is_episode(job));
                let jobs = jobs.cloned().collect();
                ended(jobs, format!("server {id} is taken by {holder}"), false)
            }
            State::Busy => (None, false),
        }
    }

    /// A server left in good order. Returns the jobs that it had.
    pub(crate) fn left(&mut self, id: u64) -> Vec<Job> {
        self.presences.remove(&id);
        self.unfit.remove(&id);
        self.strangers.remove(&id);
        self.metrics.remove(&id);
        self.seen.remove(&id);
        self.remove(id)
    }

    pub(crate) fn remove(&mut self, id: u64) -> Vec<Job> {
        self.slots
            .remove(&id)
            .map_or_else(Vec::new, |slot| slot.jobs)
    }

    /// Which start of a server is used, if it says.
    pub(crate) fn instance(&self, id: u64) -> Option<String> {
        self.slots.get(&id)?.instance.clone()
    }

    /// A server has done a job, or is not to do it any more.
    pub(crate) fn finished(&mut self, id: u64, job: &Job) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.jobs.retain(|other| other != job);
        }
    }

    /// A server failed: a pause that doubles with each failure in a row, also where it is gone and comes back.
    pub(crate) fn bench(&mut self, id: u64, reason: &str, now: Instant) {
        let until = self.health.failed(id, reason, now);
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.benched = Some(until);
        }
    }

    /// What a server was benched for last was none of its fault.
    pub(crate) fn forgive(&mut self, id: u64) {
        self.health.forgive(id);
    }

    /// A server failed what had succeeded before: a pause that doubles each time.
    pub(crate) fn broke(&mut self, id: u64, reason: &str, now: Instant) {
        let until = self.health.broke(id, reason, now);
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.benched = Some(until);
        }
    }

    /// Whether any server was heard in the second half of one's silence: not all are out of reach then. One that answers
    /// questions but not this one is there itself.
    pub(crate) fn anyone_spoke(&self, since: Instant, now: Instant) -> bool {
        let half = since + now.saturating_duration_since(since) / 2;
        self.slots.values().any(|slot| slot.heard > half)
    }

    /// Nothing came from a server in time: it gets no work before it says something, at least an answer to a question.
    pub(crate) fn fell_silent(&mut self, id: u64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = true;
        }
    }

    /// A server is new; its first work waits until `until`, or for longer where it has failed again and again.
    pub(crate) fn introduce(&mut self, id: u64, until: Instant, now: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            let pause = self.health.pause(id, now);
            slot.benched = Some(pause.map_or(until, |pause| pause.max(until)));
        }
    }

    /// A server did `episodes` in `seconds`.
    pub(crate) fn did_well(&mut self, id: u64, episodes: usize, seconds: f64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.measured(episodes, seconds);
            self.health.recovered(id);
        }
    }

    /// A server's results are wrong: it is not used any more. Returns the jobs that it had.
    pub(crate) fn distrust(&mut self, id: u64, reason: &str) -> Vec<Job> {
        self.health.distrust(id, reason);
        self.unfit.insert(id, reason.to_owned());
        self.remove(id)
    }

    /// Benched servers whose pause is over may be used again.
    pub(crate) fn unbench(&mut self, now: Instant) {
        for slot in self.slots.values_mut() {
            if slot.benched.is_some_and(|until| until <= now) {
                slot.benched = None;
            }
        }
    }

    pub(crate) fn next_unbench(&self) -> Option<Instant> {
        self.slots.values().filter_map(|slot| slot.benched).min()
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
            let answer = match self.health.failures(*id) {
                Some((1, failure)) => format!("fits, but failed: {failure}"),
                Some((times, failure)) => format!(
                    "fits, but failed {times} times in a row, the last time because: {failure}"
                ),
                None if slot.silent => "fits, but is silent".to_owned(),
                None => "fits".to_owned(),
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
        for (id, hash) in &self.strangers {
            lines.entry(*id).or_insert_with(|| {
                format!(
                    "server {id}: answers with simulation_hash {hash:?}, which is none of this tool's discoveries; it may \
                     have answered another tool, else let it return the hash of the discovery"
                )
            });
        }
        if lines.is_empty() {
            "no server at all; start one with `swarmwright serve`".to_owned()
        } else {
            lines.into_values().collect::<Vec<_>>().join("; ")
        }
    }

    /// Metrics that servers announce, sorted, for a hint at a misspelling.
    pub(crate) fn metrics(&self) -> Vec<String> {
        let mut names: Vec<String> = self.metrics.values().flatten().cloned().collect();
        names.sort();
        names.dedup();
        names
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
