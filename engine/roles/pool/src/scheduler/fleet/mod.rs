//! Servers: which there are, what each offers, how they behave, how much they can do.

pub(crate) mod capacity;
pub(crate) mod describe;
pub(crate) mod determinism;
pub(crate) mod discovery;
pub(crate) mod duplicates;
pub(crate) mod health;
pub(crate) mod lag;
pub(crate) mod left_behind;
pub(crate) mod misfits;
pub(crate) mod offers;
pub(crate) mod overtaken;
pub(crate) mod pace;
pub(crate) mod processes;
pub(crate) mod sizes;
pub(crate) mod slot;

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use swarmwright_protocol::Presence;

use crate::scheduler::fleet::health::Health;
use crate::scheduler::fleet::lag::Lag;
use crate::scheduler::fleet::left_behind::LeftBehind;
use crate::scheduler::fleet::sizes::Sizes;
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::job::Job;

/// Servers that are told one by one that they are free.
const MOST_TOLD: usize = 100;

/// All that is known of servers.
#[derive(Debug, Default)]
pub(crate) struct Fleet {
    slots: BTreeMap<u64, Slot>,
    presences: BTreeMap<u64, Presence>,
    /// Servers that answered and do not fit, or cannot be told apart.
    unfit: BTreeMap<u64, String>,
    /// Instances that answered lately by id, each with its last round.
    seen: BTreeMap<u64, Vec<(String, u64)>>,
    /// Ids used by two servers: the last round with a second answer, and how often.
    duplicates: BTreeMap<u64, (u64, u32)>,
    /// Servers that answered with a hash that this tool has not asked with, each with that hash.
    unmatched: BTreeMap<u64, String>,
    /// Why the last answer to a discovery was refused that could not be read.
    unreadable: Option<String>,
    /// Servers that refused this work as such, by id: which start of the server, and why.
    refusals: BTreeMap<u64, (Option<String>, String)>,
    /// How ids have behaved so far.
    health: Health,
    /// Metrics that servers announced for this simulation, by id, whether they fit or not.
    metrics: BTreeMap<u64, Vec<String>>,
    /// Servers that may still wait for this tool since its connection broke.
    left_behind: LeftBehind,
    /// Servers that said last that they hear control messages on their own topics; some may still wait for this tool
    /// when nothing else is known of them any more.
    on_own_topic: BTreeSet<u64>,
    /// How often a server that had been silent spoke again.
    woken: usize,
    lag: Lag,
    /// Numbers of sensors and actuators that all servers of the run have, once a server has announced them.
    sizes: Option<Sizes>,
    /// Whether the run has begun: the first numbers that a server announces are those of the run then.
    settles_sizes: bool,
}

/// Servers that may be used.
impl Fleet {
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// How many servers hear what all are told, as far as is known.
    pub fn audience(&self) -> usize {
        self.slots.len().max(self.presences.len())
    }

    /// A server that may be used.
    pub fn slot(&self, id: u64) -> Option<&Slot> {
        self.slots.get(&id)
    }

    /// All of them by id.
    pub fn slots(&self) -> impl Iterator<Item = (u64, &Slot)> {
        self.slots.iter().map(|(id, slot)| (*id, slot))
    }

    /// Those that may get work now.
    pub fn usable(&self) -> impl Iterator<Item = (u64, &Slot)> {
        self.slots().filter(|(_, slot)| slot.usable())
    }

    /// How ids have behaved so far.
    pub fn health(&self) -> &Health {
        &self.health
    }

    /// How often a server that had been silent spoke again.
    pub fn woken(&self) -> usize {
        self.woken
    }

    /// What failed on one server waits for another one of these; not for one that has a pause after failures.
    pub fn servers(&self) -> Vec<u64> {
        // One that is new and has not failed is usable in a moment.
        let new = |id: u64, slot: &Slot| {
            !slot.silent && !slot.suspended && self.health.failures(id).is_none()
        };
        let usable = self
            .slots()
            .filter(|(id, slot)| slot.usable() || new(*id, slot));
        usable.map(|(id, _)| id).collect()
    }

    /// The connection broke: forgets who is there, but for those that may still wait for this tool.
    pub fn clear(&mut self) {
        for (id, slot) in self.slots.iter().filter(|(_, slot)| slot.held) {
            self.left_behind.add(*id, slot.last_hash.clone());
        }
        *self = Self {
            health: std::mem::take(&mut self.health),
            left_behind: std::mem::take(&mut self.left_behind),
            on_own_topic: std::mem::take(&mut self.on_own_topic),
            lag: std::mem::take(&mut self.lag),
            sizes: self.sizes,
            settles_sizes: self.settles_sizes,
            ..Self::default()
        };
    }

    /// The servers that may still wait for this tool since its connection broke.
    pub fn left_behind(&mut self) -> &mut LeftBehind {
        &mut self.left_behind
    }

    /// Ends the use of all servers. Returns those that are to be told: of many, those are not that are free in some
    /// seconds anyway where all servers would hear what one is told.
    pub fn release(&mut self) -> Vec<(u64, Option<String>)> {
        let many = self.slots.values().filter(|slot| slot.held).count() > MOST_TOLD;
        let slots = std::mem::take(&mut self.slots).into_iter();
        let must_hear = |id: u64, slot: &Slot| {
            let soon_free = slot.capabilities.swarmwright.is_some();
            slot.held && !(many && soon_free && !self.hears_own_topic(id))
        };
        let listeners = slots.filter(|(id, slot)| must_hear(*id, slot));
        listeners.map(|(id, slot)| (id, slot.last_hash)).collect()
    }
}

/// The present work of servers.
impl Fleet {
    /// A server has one more job.
    pub fn began(&mut self, id: u64, job: Job) {
        if let Some(slot) = self.slots.get_mut(&id) {
            if let Job::Episode(hash) = &job {
                slot.last_hash = Some(hash.clone());
            }
            slot.jobs.push(job);
            slot.held = true;
        }
    }

    /// Takes all jobs of a server.
    pub fn take_jobs(&mut self, id: u64) -> Vec<Job> {
        let slot = self.slots.get_mut(&id);
        slot.map_or_else(Vec::new, |slot| std::mem::take(&mut slot.jobs))
    }

    /// Takes the jobs of all servers.
    pub fn take_all_jobs(&mut self) -> Vec<(u64, Vec<Job>)> {
        let slots = self.slots.iter_mut();
        slots
            .map(|(id, slot)| (*id, std::mem::take(&mut slot.jobs)))
            .collect()
    }

    /// The last hash that a server ran for this tool.
    pub fn last_hash(&self, id: u64) -> Option<String> {
        self.slots.get(&id)?.last_hash.clone()
    }

    pub fn remove(&mut self, id: u64) -> Vec<Job> {
        self.slots
            .remove(&id)
            .map_or_else(Vec::new, |slot| slot.jobs)
    }

    /// Which start of a server is used, if it says.
    pub fn instance(&self, id: u64) -> Option<String> {
        self.slots.get(&id)?.instance.clone()
    }

    /// A server has done a job, or is not to do it any more.
    pub fn finished(&mut self, id: u64, job: &Job) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.jobs.retain(|other| other != job);
        }
    }

    /// A server failed: a pause that doubles with each failure in a row, also where it is gone and comes back.
    pub fn back_off(&mut self, id: u64, reason: &str, now: Instant) {
        let until = self.health.failed(id, reason, now);
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.backs_off_until = Some(until);
        }
    }

    /// A server was silent, refused what it should do, or answered wrongly.
    pub fn failed_in_vain(&mut self, id: u64) {
        self.health.failed_in_vain(id);
    }

    /// A server refused a request, as another tool had it. Returns how many it has refused so since it succeeded with anything.
    pub fn refused_as_taken(&mut self, id: u64) -> u32 {
        self.health.refused_as_taken(id)
    }

    /// What a server was benched for last was none of its fault.
    pub fn forgive(&mut self, id: u64) {
        self.health.forgive(id);
    }

    /// A server failed what had succeeded before: a pause that doubles each time.
    pub fn broke(&mut self, id: u64, reason: &str, now: Instant) {
        let until = self.health.broke(id, reason, now);
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.backs_off_until = Some(until);
        }
    }

    /// Whether any server was heard in the second half of one's silence: not all are out of reach then. One that answers
    /// questions but not this one is there itself.
    pub fn anyone_spoke(&self, since: Instant, now: Instant) -> bool {
        let half = since + now.saturating_duration_since(since) / 2;
        self.slots.values().any(|slot| slot.heard > half)
    }

    /// Nothing came from a server in time: it gets no work before it says something, at least an answer to a question.
    pub fn fell_silent(&mut self, id: u64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = true;
        }
    }

    /// A server is new; its first work waits until `until`, or for longer where it has failed again and again.
    pub fn introduce(&mut self, id: u64, until: Instant, now: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            let pause = self.health.pause(id, now);
            slot.backs_off_until = Some(pause.map_or(until, |pause| pause.max(until)));
        }
    }

    /// A server did `episodes` in `seconds`.
    pub fn did_well(&mut self, id: u64, episodes: usize, seconds: f64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.measured(episodes, seconds);
            self.health.recovered(id);
        }
    }

    /// A server's results are wrong: it is not used any more. Returns the jobs that it had.
    pub fn distrust(&mut self, id: u64, reason: &str) -> Vec<Job> {
        self.health.distrust(id, reason);
        self.unfit.insert(id, reason.to_owned());
        self.remove(id)
    }

    /// Benched servers whose pause is over may be used again.
    pub fn end_back_offs(&mut self, now: Instant) {
        for slot in self.slots.values_mut() {
            if slot.backs_off_until.is_some_and(|until| until <= now) {
                slot.backs_off_until = None;
            }
        }
    }

    pub fn next_back_off_end(&self) -> Option<Instant> {
        self.slots
            .values()
            .filter_map(|slot| slot.backs_off_until)
            .min()
    }

    /// Something of use came from a server in an episode.
    pub fn heard(&mut self, id: u64, now: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = false;
            (slot.heard, slot.answered_at) = (now, now);
            if slot.overtaken.take().is_some() {
                self.health.answers(id);
            }
        }
    }

    /// A server answered a request.
    pub fn answered_request(&mut self, id: u64, now: Instant) {
        let silent = self.slots.get(&id).is_some_and(|slot| slot.silent);
        self.woken += usize::from(silent);
        self.heard(id, now);
    }

    /// A server says that it failed.
    pub fn spoke(&mut self, id: u64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = false;
            if slot.overtaken.take().is_some() {
                self.health.answers(id);
            }
        }
    }

    /// Time from one message of an episode or a batch to the next.
    pub fn measured_step(&mut self, id: u64, duration: Duration) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.steps.measured(duration);
        }
    }

    /// The fitness of an episode came.
    pub fn measured_episode(&mut self, id: u64, duration: Duration) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.episodes.measured(duration);
            slot.preempted = 0;
        }
    }

    /// Another tool was faster on a server. How often in a row.
    pub fn was_preempted(&mut self, id: u64) -> u32 {
        self.slots.get_mut(&id).map_or(0, |slot| {
            slot.preempted += 1;
            slot.preempted
        })
    }

    /// A server that has nothing to do is passed over: since when. None if it has something to do.
    pub fn pass_over(&mut self, id: u64, now: Instant) -> Option<Instant> {
        let slot = self.slots.get_mut(&id);
        let slot = slot.filter(|slot| slot.jobs.is_empty())?;
        Some(*slot.passed_over.get_or_insert(now))
    }

    /// Ends the exclusion of a server. Returns false if it does not exist.
    pub fn consider(&mut self, id: u64) -> bool {
        let slot = self.slots.get_mut(&id);
        slot.map(|slot| slot.passed_over = None).is_some()
    }
}

/// How servers behave.
impl Fleet {
    /// Whether a server may be of use.
    pub fn has_hope(&self) -> bool {
        let health = &self.health;
        self.slots()
            .any(|(id, slot)| !health.is_broken(id) && !health.is_useless(id) && !slot.silent)
    }

    /// The servers that have failed nothing; none while one of them has a pause: the others need not try again meanwhile.
    pub fn untried(&self) -> Option<Vec<u64>> {
        // A server that is broken is given nothing, so that it cannot tell either.
        let untried = self
            .slots()
            .filter(|(id, slot)| !slot.silent && !slot.suspended && !self.health.has_failed(*id));
        untried
            .map(|(id, slot)| slot.backs_off_until.is_none().then_some(id))
            .collect()
    }

    /// Notes that other work has begun, with other candidates.
    pub fn new_work(&mut self) {
        self.health.new_work();
    }

    /// A server succeeded with something.
    pub fn succeeded(&mut self, id: u64) {
        self.health.succeeded(id);
    }

    /// A server failed a candidate that may be to blame itself.
    pub fn failed_candidate(&mut self, id: u64, candidate: usize) {
        self.health.failed_candidate(id, candidate);
    }

    /// Servers that have failed several candidates and succeeded with none, or have said nothing of what others have
    /// finished, get nothing new before they have shown that they can evaluate what succeeded elsewhere; before anything
    /// has (`has_success`), as long as others may succeed.
    pub fn suspend(&mut self, has_success: bool) {
        if !self.health.has_doubtful() {
            return;
        }
        let sound = |id: &u64| !self.health.is_doubtful(*id);
        let mut slots = self.slots.iter();
        let hope = slots.any(|(id, slot)| sound(id) && !slot.silent);
        let doubtful: Vec<u64> = self.slots.keys().copied().filter(|id| !sound(id)).collect();
        for (id, slot) in &mut self.slots {
            slot.suspended = (has_success || hope) && doubtful.contains(id);
        }
        if doubtful.is_empty() {
            self.health.none_doubtful();
        }
    }
}

/// Brokers that hold small packets back.
impl Fleet {
    /// Messages of an episode went to its server.
    pub fn sent_to(&mut self, id: u64, messages: u32) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.answers.on_sent(messages);
        }
    }

    /// A server answered in an episode after such a time. Whether the broker is to be asked, once.
    pub fn answered_after(&mut self, id: u64, wait: Duration) -> bool {
        let Some(slot) = self.slots.get_mut(&id) else {
            return false;
        };
        slot.answers.on_answer(wait);
        self.lag.is_news(id, slot.answers)
    }

    /// What to tell of it.
    pub fn lag(&self) -> &Lag {
        &self.lag
    }
}
