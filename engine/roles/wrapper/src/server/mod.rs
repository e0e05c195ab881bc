//! The server: connection, clock, and execution of the machine's actions.

mod denials;
mod keep_alive;
mod rival;
mod words;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use swarmwright_mqtt::{
    ConnectError, Connection, Event, PublishOptions, QoS, Settings, SettingsError, Subscription,
    TooLarge, Will,
};
use swarmwright_protocol::{MEDIA_TYPE, ModuleCode, Presence, State, Topic, TopicError, Topics};
use swarmwright_worlds::{Scene, Simulation};

use crate::evaluator::{Evaluator, SHORT};
use crate::job::Job;
use crate::machine::{Action, Machine, Notice};
use crate::notice::Rival;
use crate::progress::Progress;
use crate::{Identity, identity};
use denials::Denials;
use keep_alive::KeepAlive;
use rival::find_rival;
use words::{is_scene, lost, refusal};

/// Seconds for which the broker keeps the last will of a lost server.
const LOST_EXPIRY: u32 = 3600;
/// Interval at which a running server asks whether to continue.
const ASKED_EVERY: Duration = Duration::from_millis(100);

/// Callback that shows a frame of a run.
pub type FrameHandler = Box<dyn FnMut(&Scene) + Send>;

/// Options of a server.
pub struct Options {
    /// Id of the server.
    pub id: u64,
    /// Connection settings of the broker.
    pub settings: Settings,
    /// Topic prefix, empty for none.
    pub prefix: String,
    /// How long a step may wait for actuators before the run is given up.
    pub step_timeout: Duration,
    /// Number of threads of an offloaded evaluation; 0 for one per processor. The default is 1, since several servers
    /// per machine are the unit of parallelism.
    pub threads: usize,
    /// Whether no other server can have this id, as on an optimization tool's own broker, so that there is no need to
    /// listen for one at the start.
    pub alone: bool,
    /// Called with every frame of a visual run.
    pub on_frame: Option<FrameHandler>,
    /// Progress file, for a process that supervises this one.
    pub progress: Option<Arc<Progress>>,
    /// Python behaviours and conditions that the simulation can compute.
    pub modules: Vec<ModuleCode>,
}

impl Options {
    /// Creates default options, with credentials from the environment.
    ///
    /// # Errors
    /// Fails if the URL or the credentials are invalid.
    pub fn new(id: u64, url: &str) -> Result<Self, SettingsError> {
        Ok(Self {
            id,
            settings: Settings::from_environment(url)?,
            prefix: String::new(),
            step_timeout: Duration::from_secs(60),
            threads: 1,
            alone: false,
            on_frame: None,
            progress: None,
            modules: Vec::new(),
        })
    }
}

/// The error type of a server.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The connection to the broker could not be established.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The topic prefix is invalid.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// Another server uses the id.
    #[error(
        "the id {id} is taken by a server on {location}; choose another with --id \
         (or, if that server is gone for good: mosquitto_pub -r -n -t {topic})"
    )]
    IdTaken {
        /// The id.
        id: u64,
        /// Location of the other server: its host, and its process if announced.
        location: String,
        /// Its presence topic.
        topic: String,
    },
    /// Another server took the id while this one was offline.
    #[error(
        "another server has the id {} too ({rival}): this one, which was away, leaves; start it again with another --id",
        rival.id
    )]
    IdLost {
        /// The other server.
        rival: Rival,
    },
    /// The broker denies the presence of a starting server, and closes the connection.
    #[error(
        "the broker closed the connection, since it denies this server's presence message: {0}"
    )]
    Unannounced(String),
    /// There are no simulations.
    #[error("a server needs at least one simulation")]
    NoSimulation,
}

/// A simulation server on the broker.
pub struct SimulationServer {
    machine: Machine,
    connection: KeepAlive,
    topics: Topics,
    id: u64,
    on_frame: Option<FrameHandler>,
    events: Vec<Event>,
    evaluator: Evaluator,
    /// A job that has not been started.
    pending: Option<Job>,
    /// Progress file.
    progress: Option<Arc<Progress>>,
    /// Whether the progress says that episodes are being stepped.
    is_marked: bool,
    /// Whether the server was reported as ready.
    ready: bool,
    /// Set after this server has left because another one has its id.
    rival: Option<Rival>,
    denials: Denials,
    /// Denial because of which this server has left.
    unannounced: Option<String>,
    /// A further warning for the operator, issued once.
    warning: Option<String>,
}

/// Whether a server of this process has warned that the password travels unencrypted.
static WARNED: AtomicBool = AtomicBool::new(false);

/// Returns the last will. A will is limited to 64 KiB, so the names of many metrics and sides are omitted.
fn last_words(mut presence: Presence) -> Vec<u8> {
    let whole = presence.encode();
    if whole.len() <= usize::from(u16::MAX) {
        return whole;
    }
    if let Some(announced) = &mut presence.capabilities.swarmwright {
        announced.metrics.clear();
        announced.sides.clear();
    }
    presence.encode()
}

impl SimulationServer {
    /// Connects and offers the simulations.
    ///
    /// # Errors
    /// Fails if the broker is unreachable or refuses the credentials, if the id is taken, or if there are no
    /// simulations.
    pub fn connect(
        simulations: Vec<Box<dyn Simulation>>,
        options: Options,
    ) -> Result<Self, ServeError> {
        if simulations.is_empty() {
            return Err(ServeError::NoSimulation);
        }
        let topics = Topics::new(&options.prefix)?;
        let identity = Identity {
            modules: options.modules,
            ..Identity::new(options.id)
        };
        let mut machine = Machine::new(
            identity.clone(),
            simulations,
            topics.clone(),
            options.step_timeout,
        );
        let mut settings = options.settings;
        settings.will = Some(Will {
            topic: topics.presence(options.id),
            payload: last_words(machine.presence(State::Lost, stamp())),
            expiry: LOST_EXPIRY,
            retain: true,
        });
        let at = |topic, qos| Subscription {
            filter: topics.name(topic),
            qos,
        };
        let subscriptions = vec![
            at(Topic::Discovery, QoS::AtMostOnce),
            at(Topic::Parameters, QoS::AtMostOnce),
            at(Topic::Control, QoS::AtMostOnce),
            at(Topic::Actuator, QoS::AtMostOnce),
            Subscription {
                filter: topics.to_server(options.id),
                qos: QoS::AtMostOnce,
            },
            Subscription {
                filter: topics.presence(options.id),
                qos: QoS::AtLeastOnce,
            },
        ];
        let warning = settings
            .clear_text_warning()
            .filter(|_| !WARNED.swap(true, Ordering::Relaxed));
        let keep_alive = settings.keep_alive;
        let mut connection = Connection::open(settings, subscriptions)?;
        let mut early = Vec::new();
        if !options.alone {
            early = match find_rival(&mut connection, &topics, &identity) {
                Ok(early) => early,
                Err(error) => {
                    // Close the connection properly, or the last will would declare the rightful owner of the id lost.
                    connection.close(Duration::from_secs(1));
                    return Err(error);
                }
            };
        }
        if options.alone {
            machine.set_alone();
        }
        machine.publish_presence(stamp());
        let mut server = Self {
            machine,
            evaluator: Evaluator::new(
                options.threads,
                options.progress.clone(),
                connection.waker(),
            ),
            pending: None,
            progress: options.progress,
            is_marked: false,
            ready: false,
            warning,
            connection: KeepAlive::new(connection, keep_alive),
            topics,
            id: options.id,
            on_frame: options.on_frame,
            events: early,
            rival: None,
            denials: Denials::new(Instant::now()),
            unannounced: None,
        };
        server.act(&mut |_| {});
        Ok(server)
    }

    /// Serves until `keep_going`, called at least every 0.1 s, returns false; then leaves the broker in an orderly way.
    ///
    /// # Errors
    /// Fails if another server took the id while this one was offline, or if the broker denies the presence from the
    /// start and closes the connection.
    pub fn run(
        mut self,
        mut on_notice: impl FnMut(&Notice),
        mut keep_going: impl FnMut() -> bool,
    ) -> Result<(), ServeError> {
        let mut asked_at = Instant::now();
        let mut served = Ok(());
        while served.is_ok() {
            let now = Instant::now();
            if now.duration_since(asked_at) >= ASKED_EVERY {
                asked_at = now;
                if !keep_going() {
                    break;
                }
            }
            served = self.poll_until(asked_at + ASKED_EVERY, &mut on_notice);
        }
        self.close();
        served
    }

    /// Runs one turn, for a caller with an event loop: waits at most `patience` for an event, and does what is due. A
    /// server that is not polled does not answer.
    ///
    /// # Errors
    /// Fails if another server took the id while this one was offline, or if the broker denies the presence from the
    /// start; this server must then be closed.
    pub fn poll(
        &mut self,
        patience: Duration,
        mut on_notice: impl FnMut(&Notice),
    ) -> Result<(), ServeError> {
        self.poll_until(Instant::now() + patience, &mut on_notice)
    }

    /// Gives up all current work and leaves the broker in an orderly way.
    pub fn close(mut self) {
        self.machine.free(Instant::now());
        // This server must not remove the presence of another server with its id.
        if self.rival.is_none() {
            self.connection.lock().publish(
                &self.topics.presence(self.id),
                &[],
                QoS::AtLeastOnce,
                true,
                None,
            );
        }
        self.connection.close(Duration::from_secs(1));
    }

    fn poll_until(
        &mut self,
        until: Instant,
        on_notice: &mut impl FnMut(&Notice),
    ) -> Result<(), ServeError> {
        self.turn(until, on_notice);
        if let Some(denial) = self.unannounced.take() {
            return Err(ServeError::Unannounced(denial));
        }
        match self.rival.clone() {
            Some(rival) => Err(ServeError::IdLost { rival }),
            None => Ok(()),
        }
    }

    fn turn(&mut self, until: Instant, on_notice: &mut impl FnMut(&Notice)) {
        if !std::mem::replace(&mut self.ready, true) {
            on_notice(&Notice::Ready);
            if let Some(warning) = self.warning.take() {
                on_notice(&Notice::Warning(warning));
            }
        }
        let until = if self.pending.is_some() {
            Instant::now()
        } else {
            self.machine.next_tick().map_or(until, |at| at.min(until))
        };
        self.connection.lock().poll(until, &mut self.events);
        let now = Instant::now();
        for event in self.events.drain(..) {
            match event {
                Event::Message(message) => {
                    if let Some(progress) = &self.progress
                        && !self.is_marked
                        && self.machine.may_begin(message.topic())
                    {
                        progress.stepping();
                        self.is_marked = true;
                    }
                    self.machine.receive(
                        message.topic(),
                        message.payload(),
                        message.retained(),
                        now,
                    );
                }
                Event::Connected => self.machine.connected(stamp(), now),
                Event::Disconnected { reason, unread } => {
                    self.unannounced = self.denials.reason_to_leave(now);
                    self.machine.disconnected(&lost(reason, unread), now);
                }
                Event::Denied { topic, message } => {
                    let is_presence = topic == self.topics.presence(self.id);
                    if self.denials.note(&message, is_presence, now) {
                        on_notice(&Notice::Warning(message));
                    }
                }
            }
        }
        if let Some(done) = self.evaluator.finished() {
            self.machine.finished(done, now);
        }
        if self.machine.next_tick().is_some_and(|at| at <= now) {
            self.machine.tick(now, stamp);
        }
        self.act(on_notice);
        self.unmark();
        self.machine.computed(now, Instant::now());
        self.compute(on_notice);
    }

    /// Updates the progress once stepped episodes have ended.
    fn unmark(&mut self) {
        if let Some(progress) = &self.progress
            && self.is_marked
            && !self.machine.is_stepping()
        {
            progress.ended(self.machine.take_stepped());
            progress.idle();
            self.is_marked = false;
        }
    }

    /// Computes pending jobs, and returns after a short time so that answers are sent and messages are read.
    fn compute(&mut self, on_notice: &mut impl FnMut(&Notice)) {
        let start = Instant::now();
        while let Some(job) = self.pending.take() {
            let Some(done) = self.evaluator.run(job) else {
                return;
            };
            self.machine.finished(done, Instant::now());
            self.act(on_notice);
            if start.elapsed() >= SHORT {
                return;
            }
        }
    }

    fn act(&mut self, on_notice: &mut impl FnMut(&Notice)) {
        let mut unsent = None;
        let mut connection = self.connection.lock();
        for action in self.machine.actions() {
            if self.rival.is_some() {
                // Only the other server with this id may publish.
                continue;
            }
            match action {
                Action::GiveWay(rival) => {
                    if !identity::is_dead(rival.host.as_deref(), rival.pid) {
                        self.rival = Some(rival);
                    }
                }
                Action::Publish(Topic::Presence, payload) => {
                    connection.publish(
                        &self.topics.presence(self.id),
                        &payload,
                        QoS::AtLeastOnce,
                        true,
                        None,
                    );
                }
                Action::Publish(topic, payload) => {
                    let name = self.topics.name(topic);
                    let options = PublishOptions {
                        // A tool would take a second copy for the next step.
                        confirm: topic != Topic::Sensor,
                        ..PublishOptions::default()
                    };
                    let sent = connection.publish_with(&name, &payload, &options);
                    unsent = unsent.or(sent.err().map(|error| (topic, error)));
                }
                Action::Reply {
                    topic,
                    request,
                    payload,
                } => {
                    let correlation = request.map(u64::to_be_bytes);
                    let options = PublishOptions {
                        content_type: Some(MEDIA_TYPE),
                        correlation: correlation.as_ref().map(<[u8; 8]>::as_slice),
                        confirm: true,
                        ..PublishOptions::default()
                    };
                    let topic = self.topics.under(&topic);
                    let sent = connection.publish_with(&topic, &payload, &options);
                    if let Err(error) = sent
                        && is_scene(&payload)
                    {
                        unsent = unsent.or(Some((Topic::ToTool, error)));
                    } else if let Err(TooLarge { bytes, most }) = sent {
                        let reason = format!(
                            "its answer of {bytes} bytes is larger than the {most} that the broker accepts"
                        );
                        on_notice(&Notice::Warning(reason.clone()));
                        let instead = refusal(&payload, reason);
                        let _ = connection.publish_with(&topic, &instead, &options);
                    }
                }
                Action::Evaluate(job) => self.pending = Some(job),
                Action::Notice(notice) => on_notice(&notice),
                Action::Frame(scene) => {
                    if let Some(on_frame) = &mut self.on_frame {
                        on_frame(&scene);
                    }
                }
            }
        }
        drop(connection);
        if let Some((topic, TooLarge { bytes, most })) = unsent {
            self.machine.unsent(topic, bytes, most, Instant::now());
            self.act(on_notice);
        }
    }
}

fn stamp() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

#[cfg(test)]
mod tests;
