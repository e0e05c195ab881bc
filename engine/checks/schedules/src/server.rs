//! A simulation server's process: the machine of the wrapper and what its shell does with it, in virtual time.

use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;
use swarmwright_protocol::{State, Topic, Topics};
use swarmwright_testing::Trail;
use swarmwright_worlds::Means;
use swarmwright_wrapper::{Action, Identity, Job, Machine};

use crate::network::{Filter, Will};
use crate::schedule;
use crate::schedule::Time;
use crate::trail::TITLE;

/// Steps that an episode has on average.
const STEPS: u64 = 3;

/// An outgoing message.
pub struct Outgoing {
    /// The full name of its topic.
    pub topic: Rc<str>,
    /// What is said.
    pub payload: Rc<[u8]>,
    /// Whether it is to be retained.
    pub retain: bool,
    /// How much later than now it leaves.
    pub after: Time,
}

/// A server's process.
pub struct Server {
    plan: schedule::Server,
    /// Its id.
    pub id: u64,
    /// The decisions.
    pub machine: Machine,
    instance: String,
    host: String,
    died: Arc<AtomicBool>,
    broken: Arc<AtomicBool>,
    /// The work in progress.
    pub job: Option<Job>,
    /// How many jobs there were.
    pub jobs: u64,
    /// Whether what is to be sent has been computed already.
    computed: bool,
    /// Whether another server has its id, so that it must leave.
    pub gives_way: bool,
}

impl Server {
    /// A process that has just been started.
    #[must_use]
    pub fn new(plan: &schedule::Server, index: usize, id: u64, incarnation: u64) -> Self {
        let died = Arc::new(AtomicBool::new(false));
        // Of two with one id it is not always the same that has the greater one.
        let instance = format!("{}-{index}-{incarnation}", (index as u64 + incarnation) % 3);
        let host = format!("host-{index}");
        let identity = Identity {
            id,
            instance: instance.clone(),
            host: host.clone(),
            pid: incarnation,
            modules: Vec::new(),
        };
        let title = match plan.twin {
            Some(twin) if twin.foreign => "another",
            _ => TITLE,
        };
        let broken = Arc::new(AtomicBool::new(false));
        let trail = Box::new(Trail::new(title, Arc::clone(&died), Arc::clone(&broken)));
        Self {
            machine: Machine::new(
                identity,
                vec![trail],
                Topics::default(),
                Duration::from_micros(plan.patience),
            ),
            plan: plan.clone(),
            id,
            instance,
            host,
            died,
            broken,
            job: None,
            jobs: 0,
            computed: false,
            gives_way: false,
        }
    }

    /// What tells this start of the server from others.
    #[must_use]
    pub fn instance(&self) -> &str {
        &self.instance
    }

    /// Whether it knows only the seven topics of D6.1.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.plan.plain
    }

    /// What it subscribes to.
    #[must_use]
    pub fn filters(&self) -> Vec<Filter> {
        let topics = Topics::default();
        let seed = [
            Topic::Discovery,
            Topic::Parameters,
            Topic::Control,
            Topic::Actuator,
        ]
        .map(|topic| topics.name(topic));
        let own = [topics.to_server(self.id), topics.presence(self.id)];
        let own = own.into_iter().filter(|_| !self.plan.plain);
        seed.into_iter().chain(own).map(Filter::Exactly).collect()
    }

    /// Its last will.
    #[must_use]
    pub fn will(&self) -> Option<Will> {
        let lost = || self.machine.presence(State::Lost, String::new()).encode();
        (!self.plan.plain).then(|| (Topics::default().presence(self.id).into(), lost().into()))
    }

    /// Whether its simulation has brought it down.
    #[must_use]
    pub fn has_died(&self) -> bool {
        self.died.load(Ordering::Relaxed)
    }

    /// Sets whether everything fails on this server from now on.
    pub fn set_broken(&self, broken: bool) {
        self.broken.store(broken, Ordering::Relaxed);
    }

    /// Whether no tool has it and nothing is computed.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.job.is_none() && self.machine.is_free()
    }

    /// A message came in.
    pub fn receive(&mut self, topic: &str, payload: &[u8], retained: bool, now: Instant) {
        self.machine.receive(topic, payload, retained, now);
    }

    /// Finishes the job in progress, which took `took`.
    pub fn finish(&mut self, took: Time, now: Instant) {
        if let Some(job) = self.job.take() {
            self.computed = true;
            let done = job.run(Means::default()).took(Duration::from_micros(took));
            if !self.has_died() {
                self.machine.finished(done, now);
            }
        }
    }

    /// How long it computes the job that is under way. `slowness`: how many times as slow as planned it is now.
    #[must_use]
    pub fn time(&self, slowness: u64) -> Time {
        let episodes = self.job.as_ref().map_or(0, Job::episodes) as u64;
        episodes * STEPS * self.plan.pace * slowness
    }

    /// What is to be sent; a job that begins is kept, and told by the flag.
    pub fn act(&mut self, slowness: u64) -> (Vec<Outgoing>, bool) {
        let topics = Topics::default();
        let mut messages = Vec::new();
        let mut begins = false;
        let step = if std::mem::take(&mut self.computed) {
            0
        } else {
            self.plan.pace * slowness
        };
        for action in self.machine.actions() {
            let (topic, payload, retain, after) = match action {
                Action::Publish(Topic::Presence, _) | Action::Reply { .. } if self.plan.plain => {
                    continue;
                }
                Action::Publish(Topic::Presence, payload) => {
                    (topics.presence(self.id), payload, true, 0)
                }
                Action::Publish(Topic::Server, payload) if self.plan.plain => (
                    topics.name(Topic::Server),
                    without_extensions(&payload),
                    false,
                    0,
                ),
                Action::Publish(topic, payload) => {
                    let computed = matches!(topic, Topic::Sensor | Topic::Fitness);
                    (
                        topics.name(topic),
                        payload,
                        false,
                        if computed { step } else { 0 },
                    )
                }
                Action::Reply { topic, payload, .. } => {
                    (topics.under(&topic), payload, false, step)
                }
                Action::Evaluate(job) => {
                    self.job = Some(job);
                    self.jobs += 1;
                    begins = true;
                    continue;
                }
                Action::GiveWay(rival) => {
                    // Of a start on the same machine it is known that it is dead.
                    self.gives_way |= rival.host.as_ref() != Some(&self.host);
                    continue;
                }
                Action::Notice(_) | Action::Frame(_) => continue,
            };
            messages.push(Outgoing {
                topic: topic.into(),
                payload: payload.into(),
                retain,
                after,
            });
        }
        (messages, begins)
    }

    /// What it says when it leaves in good order.
    pub fn leave(&mut self, now: Instant) -> Vec<Outgoing> {
        self.machine.free(now);
        let (mut messages, _) = self.act(1);
        if !self.plan.plain {
            let topic = Topics::default().presence(self.id).into();
            messages.push(Outgoing {
                topic,
                payload: Rc::from([]),
                retain: true,
                after: 0,
            });
        }
        messages
    }
}

/// The answer to a discovery of a server that has never heard of extensions.
fn without_extensions(payload: &[u8]) -> Vec<u8> {
    let mut message: Value = serde_json::from_slice(payload).unwrap_or_default();
    if let Some(capabilities) = message
        .get_mut("capabilities")
        .and_then(Value::as_object_mut)
    {
        capabilities.remove("swarmwright");
    }
    message.to_string().into_bytes()
}
