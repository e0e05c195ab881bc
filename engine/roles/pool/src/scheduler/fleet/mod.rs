//! The fleet: known servers, their offers, health, and capacity.

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

use swarmwright_protocol::{AnnouncedSide, Presence};

use crate::scheduler::fleet::health::Health;
use crate::scheduler::fleet::lag::Lag;
use crate::scheduler::fleet::left_behind::LeftBehind;
use crate::scheduler::fleet::sizes::Sizes;
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::job::Job;

/// Largest number of servers that are told one by one that they are free.
const MOST_TOLD: usize = 100;

/// All known servers.
#[derive(Debug, Default)]
pub(crate) struct Fleet {
    slots: BTreeMap<u64, Slot>,
    presences: BTreeMap<u64, Presence>,
    /// Servers that answered but do not fit or share an id, with the reason.
    unfit: BTreeMap<u64, String>,
    /// Instances that answered recently, by id, each with its last round.
    seen: BTreeMap<u64, Vec<(String, u64)>>,
    /// Ids used by two servers: the last round with a second answer, and the number of answers in it.
    duplicates: BTreeMap<u64, (u64, u32)>,
    /// Servers that answered with a hash that is not of this tool's discoveries, each with that hash.
    unmatched: BTreeMap<u64, String>,
    /// Why the last unreadable answer to a discovery was refused.
    unreadable: Option<String>,
    /// Servers that refused the current work, by id: the instance of the server, and the reason.
    refusals: BTreeMap<u64, (Option<String>, String)>,
    /// Health of each id.
    health: Health,
    /// Metrics that servers announced for this simulation, by id, whether the servers fit or not.
    metrics: BTreeMap<u64, Vec<String>>,
    /// Sides that servers announced for this simulation, likewise.
    sides: BTreeMap<u64, Vec<AnnouncedSide>>,
    /// Servers that may still wait for this tool although its connection broke.
    left_behind: LeftBehind,
    /// Servers that last announced that they receive control messages on their own topics. They are kept after
    /// everything else about a server is forgotten, because some may still wait for this tool.
    on_own_topic: BTreeSet<u64>,
    /// Number of times that a silent server answered again.
    woken: usize,
    lag: Lag,
    /// Numbers of sensors and actuators of all servers of the run, once a server has announced them.
    sizes: Option<Sizes>,
    /// Whether the run has begun: the numbers that a server announces first then apply to the run.
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

    /// Returns the number of known servers that receive what is sent to all.
    pub fn audience(&self) -> usize {
        self.slots.len().max(self.presences.len())
    }

    /// Returns a server that may be used.
    pub fn slot(&self, id: u64) -> Option<&Slot> {
        self.slots.get(&id)
    }

    /// Returns all servers that may be used, by id.
    pub fn slots(&self) -> impl Iterator<Item = (u64, &Slot)> {
        self.slots.iter().map(|(id, slot)| (*id, slot))
    }

    /// Returns the servers that may get work now.
    pub fn usable(&self) -> impl Iterator<Item = (u64, &Slot)> {
        self.slots().filter(|(_, slot)| slot.usable())
    }

    /// Returns the ids of servers that do not announce their instance, which two servers may share.
    pub fn without_instance(&self) -> BTreeSet<u64> {
        let doubtful = self.slots().filter(|(_, slot)| slot.instance.is_none());
        doubtful.map(|(id, _)| id).collect()
    }

    /// Returns the health of all ids.
    pub fn health(&self) -> &Health {
        &self.health
    }

    /// Returns the number of times that a silent server answered again.
    pub fn woken(&self) -> usize {
        self.woken
    }

    /// Returns the servers that failed work may wait for; servers that back off after failures are not among them.
    pub fn servers(&self) -> Vec<u64> {
        // A new server that has not failed becomes usable in a moment.
        let new = |id: u64, slot: &Slot| {
            !slot.silent && !slot.suspended && self.health.failures(id).is_none()
        };
        let usable = self
            .slots()
            .filter(|(id, slot)| slot.usable() || new(*id, slot));
        usable.map(|(id, _)| id).collect()
    }

    /// Forgets the servers after the connection broke, except those that may still wait for this tool.
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

    /// Returns the servers that may still wait for this tool although its connection broke.
    pub fn left_behind(&mut self) -> &mut LeftBehind {
        &mut self.left_behind
    }

    /// Stops using all servers. Returns those to notify: if there are many, servers that become free in a few seconds
    /// anyway are left out unless they have a topic of their own.
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

/// Current work of servers.
impl Fleet {
    /// Adds a job to a server.
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

    /// Returns the hash of the last episode that a server ran for this tool.
    pub fn last_hash(&self, id: u64) -> Option<String> {
        self.slots.get(&id)?.last_hash.clone()
    }

    pub fn remove(&mut self, id: u64) -> Vec<Job> {
        self.slots
            .remove(&id)
            .map_or_else(Vec::new, |slot| slot.jobs)
    }

    /// Returns the instance of a server, if it announces one.
    pub fn instance(&self, id: u64) -> Option<String> {
        self.slots.get(&id)?.instance.clone()
    }

    /// Removes a job that a server has finished or should not do any more.
    pub fn finished(&mut self, id: u64, job: &Job) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.jobs.retain(|other| other != job);
        }
    }

    /// Lets a server back off after a failure; the pause doubles with each failure in a row, even if the server
    /// reconnects.
    pub fn back_off(&mut self, id: u64, reason: &str, now: Instant) {
        let until = self.health.failed(id, reason, now);
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.backs_off_until = Some(until);
        }
    }

    /// Records that a server was silent, refused work, or answered wrongly.
    pub fn failed_in_vain(&mut self, id: u64) {
        self.health.failed_in_vain(id);
    }

    /// Records a refusal because another tool had the server. Returns the number of such refusals since its last
    /// success.
    pub fn refused_as_taken(&mut self, id: u64) -> u32 {
        self.health.refused_as_taken(id)
    }

    /// Forgives the last failure of a server, which was not its fault.
    pub fn forgive(&mut self, id: u64) {
        self.health.forgive(id);
    }

    /// Records that a server failed an evaluation that had succeeded before; the pause doubles each time.
    pub fn broke(&mut self, id: u64, reason: &str, now: Instant) {
        let until = self.health.broke(id, reason, now);
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.backs_off_until = Some(until);
        }
    }

    /// Returns whether any server was heard in the second half of a silence since `since`: if so, the connection works.
    /// This includes a silent server that answers discoveries but not its work.
    pub fn anyone_spoke(&self, since: Instant, now: Instant) -> bool {
        let half = since + now.saturating_duration_since(since) / 2;
        self.slots.values().any(|slot| slot.heard > half)
    }

    /// Marks a server as silent: it gets no work until it sends a message, such as an answer to a discovery.
    pub fn fell_silent(&mut self, id: u64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = true;
        }
    }

    /// Lets the first work of a new server wait until `until`, or longer if the server has failed repeatedly.
    pub fn introduce(&mut self, id: u64, until: Instant, now: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            let pause = self.health.pause(id, now);
            slot.backs_off_until = Some(pause.map_or(until, |pause| pause.max(until)));
        }
    }

    /// Records that a server did `episodes` in `seconds`.
    pub fn did_well(&mut self, id: u64, episodes: usize, seconds: f64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.measured(episodes, seconds);
            self.health.recovered(id);
        }
    }

    /// Excludes a server whose results are wrong. Returns its jobs.
    pub fn distrust(&mut self, id: u64, reason: &str) -> Vec<Job> {
        self.health.distrust(id, reason);
        self.unfit.insert(id, reason.to_owned());
        self.remove(id)
    }

    /// Ends the back-offs that are over.
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

    /// Records that a usable message of an episode came from a server.
    pub fn heard(&mut self, id: u64, now: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = false;
            (slot.heard, slot.answered_at) = (now, now);
            if slot.overtaken.take().is_some() {
                self.health.answers(id);
            }
        }
    }

    /// Records that a server answered a request.
    pub fn answered_request(&mut self, id: u64, now: Instant) {
        let silent = self.slots.get(&id).is_some_and(|slot| slot.silent);
        self.woken += usize::from(silent);
        self.heard(id, now);
    }

    /// Records that a server reported its own failure.
    pub fn spoke(&mut self, id: u64) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.silent = false;
            if slot.overtaken.take().is_some() {
                self.health.answers(id);
            }
        }
    }

    /// Records the time between two messages of an episode or a batch.
    pub fn measured_step(&mut self, id: u64, duration: Duration) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.steps.measured(duration);
        }
    }

    /// Records the duration of an episode whose fitness arrived.
    pub fn measured_episode(&mut self, id: u64, duration: Duration) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.episodes.measured(duration);
            slot.preempted = 0;
        }
    }

    /// Records that another tool got the server first. Returns how often in a row this has happened.
    pub fn was_preempted(&mut self, id: u64) -> u32 {
        self.slots.get_mut(&id).map_or(0, |slot| {
            slot.preempted += 1;
            slot.preempted
        })
    }

    /// Records that an idle server is passed over. Returns since when; `None` if it has work.
    pub fn pass_over(&mut self, id: u64, now: Instant) -> Option<Instant> {
        let slot = self.slots.get_mut(&id);
        let slot = slot.filter(|slot| slot.jobs.is_empty())?;
        Some(*slot.passed_over.get_or_insert(now))
    }

    /// Ends the passing over of a server. Returns whether the server exists.
    pub fn consider(&mut self, id: u64) -> bool {
        let slot = self.slots.get_mut(&id);
        slot.map(|slot| slot.passed_over = None).is_some()
    }
}

/// Behaviour of servers.
impl Fleet {
    /// Returns whether any server may be of use.
    pub fn has_hope(&self) -> bool {
        let health = &self.health;
        self.slots()
            .any(|(id, slot)| !health.is_broken(id) && !health.is_useless(id) && !slot.silent)
    }

    /// Returns the servers on which no candidate has failed; `None` while one of them backs off, since the other
    /// servers need not try again in the meantime.
    pub fn untried(&self) -> Option<Vec<u64>> {
        // A suspended server gets no new work, so it cannot tell.
        let untried = self
            .slots()
            .filter(|(id, slot)| !slot.silent && !slot.suspended && !self.health.has_failed(*id));
        untried
            .map(|(id, slot)| slot.backs_off_until.is_none().then_some(id))
            .collect()
    }

    /// Records that new work with other candidates has begun.
    pub fn new_work(&mut self) {
        self.health.new_work();
    }

    /// Records that a server succeeded.
    pub fn succeeded(&mut self, id: u64) {
        self.health.succeeded(id);
    }

    /// Records that a candidate failed on a server; the candidate itself may be to blame.
    pub fn failed_candidate(&mut self, id: u64, candidate: usize) {
        self.health.failed_candidate(id, candidate);
    }

    /// Suspends the servers in doubt: several candidates have failed on them without a success, or other servers have
    /// finished their unanswered work. They get no new work until they succeed with an evaluation that succeeded
    /// before. While nothing has succeeded yet (`has_success` is false), they are suspended only if other servers may
    /// succeed.
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

/// Detection of brokers that hold small packets back.
impl Fleet {
    /// Records that messages of an episode were sent to a server.
    pub fn sent_to(&mut self, id: u64, messages: u32) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.answers.on_sent(messages);
        }
    }

    /// Records an answer of a server in an episode. Returns whether to probe the broker, which is done once.
    pub fn answered_after(&mut self, id: u64, wait: Duration) -> bool {
        let Some(slot) = self.slots.get_mut(&id) else {
            return false;
        };
        slot.answers.on_answer(wait);
        self.lag.is_news(id, slot.answers)
    }

    /// Returns the suspected delay, for a warning.
    pub fn lag(&self) -> &Lag {
        &self.lag
    }
}
