//! The pool's shell: connection, clock, the scheduler's actions carried out.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::{Map, Value};
use swarmwright_mqtt::{
    ConnectError, Connection, Event, PublishOptions, QoS, Settings, SettingsError, Subscription,
    TooLarge,
};
use swarmwright_protocol::{Activity, Status, Topic, TopicError, Topics};

use crate::config::{Config, Faults};
use crate::counts::Counts;
use crate::demand::Demand;
use crate::journal::Attempt;
use crate::mode::Mode;
use crate::scheduler::fleet::discovery::PROBATION;
use crate::scheduler::queue::results::{Results, Settled};
use crate::scheduler::{Action, Scheduler};
use crate::shell::probe::Probe;
use crate::shell::report::{Listener, Report, Reporter};
use crate::shell::supervision::Supervision;
use crate::work::{Work, WorkError};

/// How often the caller is asked whether to go on.
const ASK: Duration = Duration::from_millis(100);

/// How often the scheduler is asked when it needs a tick, for each of its servers: it looks at all of them.
const ASK_TICK: Duration = Duration::from_micros(5);

/// After such a time without a look, what came meanwhile is read before anybody is thought to be late.
const AWAY: Duration = Duration::from_millis(300);

/// How often it is told how many warnings were like those before.
const COUNT: Duration = Duration::from_secs(10);

/// A connection that ends so soon after a status ended because of it, if it does so again and again: some brokers end
/// that of a client that publishes where the access rules deny it (Mosquitto 2.0.11).
const AT_ONCE: Duration = Duration::from_millis(100);
const AGAIN: u32 = 2;

/// How often those who watch are told how it stands.
const TELL: Duration = Duration::from_secs(1);

/// What the work is for, as those who watch are told.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct About {
    /// Name of the run.
    pub run: Option<String>,
    /// The generation under way, from 0.
    pub generation: Option<u64>,
    /// Generations of the whole run.
    pub generations: Option<u64>,
    /// In steady state: how many evaluations had been done before the work, and how many the whole run has.
    pub evaluations: Option<(u64, u64)>,
}

/// How a pool is to work.
#[derive(Debug, Clone)]
pub struct Options {
    /// Where the broker is.
    pub settings: Settings,
    /// Topic prefix, empty for none.
    pub prefix: String,
    /// Name of the tool for people to read; host, process and a random number are added.
    pub tool: String,
    /// What a server must offer.
    pub demand: Demand,
    /// Parameters of the simulation.
    pub parameters: Map<String, Value>,
    /// Whether servers are to show their runs, which are stepwise then, whatever the demand says.
    pub visual: bool,
    /// How long to look for a first server.
    pub discovery_timeout: Duration,
    /// How long a server may be silent in an episode, and how long work may wait for any server.
    pub step_timeout: Duration,
    /// What is done about servers and evaluations that fail, are slow, or wrong.
    pub faults: Faults,
    /// Most evaluations in one request.
    pub largest: usize,
    /// Whether all servers on the broker are the tool's own, so that no two of them have one id.
    pub alone: bool,
}

/// Why the pool cannot do its work.
#[derive(Debug, thiserror::Error)]
pub enum PoolError {
    /// No connection to the broker.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The URL or the credentials cannot be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A prefix that cannot stand before a topic.
    #[error(transparent)]
    Topic(#[from] TopicError),
    /// No server fits, or all have gone.
    #[error("no server fits on {url} after {seconds:.0} s; {description}")]
    NoServer {
        /// The broker.
        url: String,
        /// How long was waited.
        seconds: f64,
        /// What was required and what was found.
        description: String,
        /// Titles that servers offer.
        titles: Vec<String>,
    },
    /// The servers do not say how many sensors and actuators there are.
    #[error(
        "the servers do not announce their numbers of sensors and actuators; add `sensors:` and `actuators:` to the experiment"
    )]
    NoSizes,
    /// Every server refuses the work.
    #[error("no server can do this work: {0}")]
    Rejected(String),
    /// Genomes that do not fit.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// A part of the work is larger than the broker takes.
    #[error("{0}")]
    TooLarge(String),
    /// Two servers do not find the same, and nobody can tell which one is wrong.
    #[error("servers disagree: {0}")]
    Disagreement(String),
    /// Nobody can tell whether candidates or servers are to blame, or all servers are broken.
    #[error("{0}")]
    Hopeless(String),
    /// The caller wants to stop.
    #[error("interrupted")]
    Interrupted,
}

/// The optimization tool's connection to its servers.
pub struct Pool {
    scheduler: Scheduler,
    connection: Connection,
    topics: Topics,
    /// The topic on which requests are answered.
    reply: String,
    /// The topic on which those who watch are told how it stands.
    status: String,
    about: About,
    tell_at: Instant,
    /// When they were told last, and how often in a row the connection ended right after it.
    told_at: Option<Instant>,
    /// Bytes of the largest packet that the broker has read of this connection.
    read: usize,
    ended_at_once: u32,
    /// When the scheduler needs a tick, as it said when it was asked last, and when to ask again.
    tick_at: Instant,
    ask_at: Instant,
    /// When to tell how many warnings were like those before.
    count_at: Instant,
    /// When it was last looked what came.
    looked: Instant,
    discovery_timeout: Duration,
    step_timeout: Duration,
    probation: Duration,
    events: Vec<Event>,
    warnings: Vec<String>,
    reporter: Reporter,
    supervision: Supervision,
    probe: Probe,
    wall: (Instant, f64),
}

impl Pool {
    /// Connects; servers are looked for from the first `poll` on.
    ///
    /// # Errors
    /// No broker, credentials refused, a prefix that cannot be.
    pub fn connect(options: Options) -> Result<Self, PoolError> {
        let topics = Topics::new(&options.prefix)?;
        let token = format!("{:016x}", fastrand::u64(..));
        let mut demand = options.demand;
        if options.visual {
            demand.mode = Mode::Stepwise;
        }
        let at = |topic| Subscription {
            filter: topics.name(topic),
            qos: QoS::AtMostOnce,
        };
        let subscriptions = vec![
            at(Topic::Server),
            at(Topic::Sensor),
            at(Topic::Fitness),
            Subscription {
                filter: topics.to_tool(&token),
                qos: QoS::AtMostOnce,
            },
            Subscription {
                filter: topics.presence_filter(),
                qos: QoS::AtLeastOnce,
            },
        ];
        let connection = Connection::open(options.settings.clone(), subscriptions)?;
        let probation = if options.alone {
            Duration::ZERO
        } else {
            PROBATION
        };
        let host = gethostname::gethostname().to_string_lossy().into_owned();
        let config = Config {
            demand,
            token: token.clone(),
            parameters: options.parameters,
            tool: format!(
                "{}@{host}/{}/{:04x}",
                options.tool,
                std::process::id(),
                fastrand::u16(..)
            ),
            topics: topics.clone(),
            visual: options.visual,
            step_timeout: options.step_timeout,
            faults: options.faults,
            largest: options.largest.max(1),
            probation,
            // Leaves room for 2^52 episodes below the 2^53 at which JSON's integers end.
            first_instance: fastrand::u64(..1 << 52),
        };
        let now = Instant::now();
        let since_1970 = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default()
            .as_secs_f64();
        let mut scheduler = Scheduler::new(config, now);
        scheduler.set_largest_packet(connection.largest_packet());
        Ok(Self {
            scheduler,
            supervision: Supervision::new(connection.waker()),
            probe: Probe::new(options.settings, connection.waker()),
            connection,
            reply: topics.to_tool(&token),
            status: topics.status(&token),
            about: About::default(),
            tell_at: now,
            told_at: None,
            read: 0,
            ended_at_once: 0,
            tick_at: now,
            ask_at: now,
            count_at: now + COUNT,
            looked: now,
            probation,
            topics,
            discovery_timeout: options.discovery_timeout,
            step_timeout: options.step_timeout,
            events: Vec::new(),
            warnings: Vec::new(),
            reporter: Reporter::default(),
            wall: (now, since_1970),
        })
    }

    /// Waits until a fitting server is there and returns its numbers of sensors and actuators, 0 where nobody says them and
    /// none are `needed`. As long as one that fits serves somebody else, waits on; `on_wait`, called ten times a second,
    /// hears of it and may stop the wait.
    ///
    /// # Errors
    /// No server fits within the discovery time-out; the servers do not announce sizes; stopped.
    pub fn wait_for_server(
        &mut self,
        needed: bool,
        mut on_wait: impl FnMut(&str) -> bool,
    ) -> Result<(usize, usize), PoolError> {
        let start = Instant::now();
        // A server that was busy and has just become free still has to answer.
        let mut free_since = start;
        loop {
            self.poll(Instant::now() + ASK);
            if self.scheduler.has_server() {
                // Another server with the same id would answer now, and then neither is used.
                let settled = Instant::now() + self.probation;
                while Instant::now() < settled {
                    self.poll(settled);
                }
            }
            if self.scheduler.has_server() {
                return match self.scheduler.sizes() {
                    None if needed => Err(PoolError::NoSizes),
                    sizes => Ok(sizes.unwrap_or_default()),
                };
            }
            let waited = start.elapsed();
            let busy = self.scheduler.busy_elsewhere();
            if busy.is_some() {
                free_since = Instant::now();
            } else if free_since.elapsed() >= self.discovery_timeout {
                return Err(self.no_server(waited));
            }
            let reason =
                busy.unwrap_or_else(|| format!("no server for {:.1} s", waited.as_secs_f64()));
            if !on_wait(&reason) {
                return Err(PoolError::Interrupted);
            }
        }
    }

    fn no_server(&self, waited: Duration) -> PoolError {
        PoolError::NoServer {
            url: self.connection.url(),
            seconds: waited.as_secs_f64(),
            description: self.scheduler.describe(),
            titles: self.scheduler.titles(),
        }
    }

    /// Evaluates every candidate in every episode. `on_progress(done, waiting_for)` is called ten times a second and at
    /// the end, and may stop the work.
    ///
    /// # Errors
    /// No server for longer than the time-outs allow; all servers refuse the work; stopped. What is under way is ended
    /// then.
    pub fn evaluate(
        &mut self,
        work: Work,
        mut on_progress: impl FnMut(usize, &str) -> bool,
    ) -> Result<Results, PoolError> {
        self.drive(
            work,
            |_| Ok(true),
            |_, done, waiting_for| on_progress(done, waiting_for),
        )?;
        Ok(self.scheduler.take_results())
    }

    /// Evaluates candidates as they come. `feed` gets those of which all episodes have ended (none when there is only
    /// something to warn of) and how that went, and returns the genomes of further ones, (candidates, weights) row-major, or none to stop. The end is reached when all
    /// have ended and `feed` had no more. `on_progress(done, total, waiting_for)` as for [`evaluate`](Self::evaluate).
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate); genomes that do not fit.
    pub fn stream(
        &mut self,
        work: Work,
        mut feed: impl FnMut(Settled, Vec<Attempt>, Vec<String>) -> Option<Vec<f32>>,
        mut on_progress: impl FnMut(usize, usize, &str) -> bool,
    ) -> Result<(), PoolError> {
        let take = |pool: &mut Self| {
            let settled = pool.scheduler.take_settled();
            if settled.candidates.is_empty() && pool.warnings.is_empty() {
                return Ok(true);
            }
            let Some(genomes) = feed(settled, pool.take_journal(), pool.take_warnings()) else {
                return Ok(false);
            };
            pool.scheduler.extend(&genomes, Instant::now())?;
            pool.act();
            Ok(true)
        };
        self.drive(work, take, |pool, done, waiting_for| {
            on_progress(done, pool.scheduler.total(), waiting_for)
        })
    }

    /// Works until all has ended, or `step`, called whenever something may have come, says no.
    fn drive(
        &mut self,
        work: Work,
        mut step: impl FnMut(&mut Self) -> Result<bool, PoolError>,
        mut on_progress: impl FnMut(&Self, usize, &str) -> bool,
    ) -> Result<(), PoolError> {
        self.scheduler.submit(work, Instant::now());
        let mut asked = Instant::now();
        let patience = self.discovery_timeout.max(self.step_timeout);
        let mut free_since = asked;
        let result = loop {
            self.poll(asked + ASK);
            // What ends during the step is taken by the next one.
            let all = self.scheduler.finished();
            match step(self) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(error) => break Err(error),
            }
            let now = Instant::now();
            if all && self.scheduler.finished() {
                on_progress(self, self.scheduler.done(), "");
                let status = self.stand(now);
                self.reporter.tell(&Report::Status(
                    &status,
                    self.connection.traffic(),
                    *self.scheduler.counts(),
                ));
                return Ok(());
            }
            if now.duration_since(asked) >= ASK {
                asked = now;
                if let Some(told) = self.scheduler.disagreement() {
                    break Err(PoolError::Disagreement(told.to_owned()));
                }
                if let Some(told) = self.scheduler.hopeless() {
                    break Err(PoolError::TooLarge(told.to_owned()));
                }
                if let Some(told) = self.scheduler.undecided(self.discovery_timeout, now) {
                    break Err(PoolError::Hopeless(told));
                }
                if let Some(reason) = self.scheduler.rejected(now) {
                    break Err(PoolError::Rejected(reason));
                }
                let lonely = self.scheduler.lonely(now);
                if self.scheduler.busy_elsewhere().is_some() || self.supervision.are_starting() {
                    free_since = now;
                } else if lonely.min(now.duration_since(free_since)) >= patience {
                    break Err(self.no_server(lonely));
                }
                if !on_progress(
                    self,
                    self.scheduler.done(),
                    &self.scheduler.waiting_for(now),
                ) {
                    break Err(PoolError::Interrupted);
                }
            }
        };
        self.scheduler.cancel();
        self.poll(Instant::now());
        result
    }

    /// What the work that follows is for.
    pub fn set_about(&mut self, about: About) {
        self.supervision.set_generation(about.generation);
        self.about = about;
    }

    /// The processes of these servers are the tool's own. What is returned is for whoever watches them.
    #[must_use]
    pub fn watch(&mut self, servers: impl IntoIterator<Item = u64>) -> Supervision {
        self.scheduler.watch(servers);
        self.supervision.clone()
    }

    /// What whoever watches processes has said, or the broker, which was asked.
    fn heed(&mut self, now: Instant) {
        let (endings, alive) = self.supervision.take();
        for server in alive {
            self.scheduler.is_alive(server, now);
        }
        for ending in endings {
            self.scheduler.ended(&ending, now);
        }
        if let Some(found) = self.probe.take() {
            self.scheduler
                .broker_holds_back(found, &self.connection.url());
        }
    }

    /// Has somebody told what happens, as it happens.
    pub fn listen(&mut self, listener: Listener) {
        self.reporter = Reporter::new(listener);
    }

    /// How it stands, and with what.
    fn stand(&self, now: Instant) -> Status {
        let mut status = self.scheduler.status(now);
        status.run = self.about.run.clone();
        (status.generation, status.generations) = (self.about.generation, self.about.generations);
        if let Some((before, total)) = self.about.evaluations {
            (status.done, status.total) = (status.done + before, total);
        }
        status
    }

    /// Tells those who watch how it stands.
    fn tell(&mut self, left: bool, now: Instant) {
        self.tell_at = now + TELL;
        let mut status = self.stand(now);
        if left {
            status.state = Activity::Left;
        }
        self.reporter.tell(&Report::Status(
            &status,
            self.connection.traffic(),
            *self.scheduler.counts(),
        ));
        if self.ended_at_once < AGAIN {
            self.told_at = Some(now);
            self.connection
                .publish(&self.status, &status.encode(), QoS::AtMostOnce, false, None);
        }
    }

    /// Metrics that servers with this simulation announce, sorted.
    #[must_use]
    pub fn metrics(&self) -> Vec<String> {
        self.scheduler.metrics()
    }

    /// Incidents so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.scheduler.counts()
    }

    /// Sends what is to be sent and handles what came, until `until` at the latest.
    fn poll(&mut self, until: Instant) {
        let now = Instant::now();
        // This process was stopped, or the machine slept: the others were not silent, their words are still unread.
        let away = now.duration_since(self.looked) >= AWAY;
        let deadline = now + AWAY;
        while away && self.hear(now) && self.looked < deadline {}
        let mut wake = until;
        if now < self.ask_at {
            wake = wake.min(self.ask_at);
        } else {
            self.ask_tick(now);
        }
        if self.tick_at <= now {
            self.scheduler.tick(now);
            self.ask_tick(now);
        }
        if self.tell_at <= now {
            self.tell(false, now);
        }
        if self.count_at <= now {
            self.count_alike(now);
        }
        self.heed(now);
        self.act();
        self.hear(wake.min(self.tick_at));
        self.heed(Instant::now());
        self.act();
        self.reporter.look(&self.scheduler, self.looked);
    }

    /// Tells of the warnings that were like those before.
    fn count_alike(&mut self, now: Instant) {
        self.count_at = now + COUNT;
        for text in self.scheduler.take_repeated() {
            self.reporter.tell(&Report::Warning(&text));
            self.warnings.push(text);
        }
    }

    /// The connection ended: perhaps on the large packet that the broker has not read, or for how this tool stands.
    fn suspect(&mut self, unread: usize, now: Instant) {
        let at_once = |told: Instant| now.saturating_duration_since(told) < AT_ONCE;
        if unread == 0 {
            self.suspect_status(now);
        } else if !self.told_at.take().is_some_and(at_once) || self.ended_at_once >= AGAIN {
            // Otherwise it may be either.
            self.scheduler.ended_on(unread, now);
        }
    }

    /// The connection ended: perhaps since the broker does not let this tool say how it stands.
    fn suspect_status(&mut self, now: Instant) {
        let at_once = |told: Instant| now.saturating_duration_since(told) < AT_ONCE;
        if !self.told_at.take().is_some_and(at_once) {
            if self.ended_at_once < AGAIN {
                self.ended_at_once = 0;
            }
            return;
        }
        self.ended_at_once += 1;
        if self.ended_at_once == AGAIN {
            let text = format!(
                "the broker ends the connection whenever this tool publishes on {}, so it does not any more: those who \
                 watch see nothing of it; mend the broker's access rules",
                self.status
            );
            self.reporter.tell(&Report::Warning(&text));
            self.warnings.push(text);
        }
    }

    fn ask_tick(&mut self, now: Instant) {
        self.tick_at = self.scheduler.next_tick();
        let servers = u32::try_from(self.scheduler.holdings().servers).unwrap_or(u32::MAX);
        self.ask_at = now + ASK_TICK * servers;
    }

    /// Handles what comes until `until`, or a part of it. Whether anything came.
    fn hear(&mut self, until: Instant) -> bool {
        self.connection.poll(until, &mut self.events);
        let now = Instant::now();
        self.looked = now;
        let came = !self.events.is_empty();
        let read = self.connection.largest_read();
        if std::mem::replace(&mut self.read, read) < read {
            self.scheduler.was_read(read);
        }
        let unread = |event: &Event| match event {
            Event::Disconnected { unread, .. } => Some(*unread),
            _ => None,
        };
        if let Some(unread) = self.events.iter().find_map(unread) {
            self.suspect(unread, now);
        }
        for event in self.events.drain(..) {
            match event {
                Event::Message(message) => {
                    self.reporter
                        .heard(&self.scheduler, message.topic(), message.payload());
                    self.scheduler.receive(
                        message.topic(),
                        message.payload(),
                        message.retained(),
                        now,
                    );
                }
                Event::Connected => {
                    self.warnings.push("the broker is back".to_owned());
                    self.reporter.tell(&Report::BrokerBack);
                    self.scheduler
                        .set_largest_packet(self.connection.largest_packet());
                    self.scheduler.connected(now);
                }
                Event::Disconnected { reason, .. } => {
                    self.reporter.tell(&Report::BrokerLost(&reason));
                    self.warnings
                        .push(format!("lost the broker ({reason}); trying again"));
                    self.scheduler.disconnected(now);
                }
            }
        }
        came
    }

    fn act(&mut self) {
        let mut unsent = Vec::new();
        let mut sent = Vec::new();
        for action in self.scheduler.actions() {
            match action {
                Action::Publish(topic, payload) => {
                    self.connection.publish(
                        &self.topics.name(topic),
                        &payload,
                        QoS::AtMostOnce,
                        false,
                        None,
                    );
                }
                Action::Request {
                    server,
                    request,
                    payload,
                } => {
                    let options = PublishOptions {
                        content_type: Some("application/msgpack"),
                        response_topic: Some(&self.reply),
                        correlation: Some(&request.to_be_bytes()),
                        ..PublishOptions::default()
                    };
                    let topic = self.topics.to_server(server);
                    sent.push(request);
                    if let Err(TooLarge { bytes, most }) =
                        self.connection.publish_with(&topic, &payload, &options)
                    {
                        unsent.push((request, format!("a request of {bytes} bytes is larger than the {most} that the broker takes")));
                    }
                }
                Action::Warn(text) => {
                    self.reporter.tell(&Report::Warning(&text));
                    self.warnings.push(text);
                }
                Action::Overdue(server) => self.supervision.is_overdue(server),
                Action::AskBroker => self.probe.ask(),
            }
        }
        for request in sent {
            if let Some((candidate, episode)) = self.scheduler.place(request) {
                self.supervision.sent(request, candidate, episode);
            }
        }
        for (request, reason) in unsent {
            self.scheduler.unsent(request, &reason, Instant::now());
        }
    }

    /// What the user should know, since the last call.
    pub fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// The attempts made since the last call.
    pub fn take_journal(&mut self) -> Vec<Attempt> {
        let (zero, since_1970) = self.wall;
        let journal = self.scheduler.take_journal();
        self.reporter.taken();
        journal
            .into_iter()
            .map(|(mut attempt, started)| {
                attempt.started =
                    since_1970 + started.saturating_duration_since(zero).as_secs_f64();
                attempt
            })
            .collect()
    }

    /// Frees the servers and leaves the broker.
    pub fn close(mut self) {
        self.scheduler.release();
        self.act();
        self.count_alike(Instant::now());
        self.tell(true, Instant::now());
        self.connection.close(Duration::from_secs(1));
    }
}
