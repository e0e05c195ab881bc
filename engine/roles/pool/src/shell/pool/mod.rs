//! The pool: connection, clock, and execution of the scheduler's actions.

mod evaluate;
mod exchange;
mod telling;

use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event, QoS, Subscription, Waker, Will};
use swarmwright_protocol::{Activity, AnnouncedSide, Status, Topic, Topics};

use crate::config::Config;
use crate::counts::Counts;
use crate::journal::{Attempt, Warning};
use crate::mode::Mode;
use crate::scheduler::Scheduler;
use crate::scheduler::fleet::discovery::PROBATION;
use crate::sections::Timeouts;
use crate::shell::error::PoolError;
use crate::shell::load::Load;
use crate::shell::options::{About, Options};
use crate::shell::outages::Outages;
use crate::shell::probe::Probe;
use crate::shell::report::{Listener, Reporter};
use crate::shell::supervision::Supervision;
use crate::shell::wall::Wall;
use crate::work::WorkError;

/// Interval between calls of the caller's callback.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Seconds for which the broker keeps the last will for an absent monitor.
const WILL_EXPIRY: u32 = 60;

/// Interval between reports of repeated warnings.
const REPEATS_INTERVAL: Duration = Duration::from_secs(10);

/// The optimization tool's connection to its servers.
pub struct Pool {
    scheduler: Scheduler,
    connection: Connection,
    topics: Topics,
    /// Topic on which requests are answered.
    reply: String,
    /// Topic of the status for monitors.
    status: String,
    about: About,
    tell_at: Instant,
    /// When the status was last published since the connection began, if it was.
    told_at: Option<Instant>,
    /// Size in bytes of the largest packet on this connection that the broker has read.
    read: usize,
    ended_at_once: u32,
    /// Why the broker denies the discovery of servers, for users.
    denied: Option<String>,
    /// When the scheduler needs a tick, as of the last query, and when to query it again.
    tick_at: Instant,
    ask_at: Instant,
    /// When to report repeated warnings.
    count_at: Instant,
    /// Time of the last poll of the connection.
    looked: Instant,
    timeouts: Timeouts,
    probation: Duration,
    events: Vec<Event>,
    warnings: Vec<Warning>,
    reporter: Reporter,
    outages: Outages,
    supervision: Supervision,
    probe: Probe,
    wall: Wall,
    load: Load,
}

impl Pool {
    /// Connects to the broker; the discovery of servers begins with the first `poll`.
    ///
    /// # Errors
    /// Fails if the broker is unreachable or refuses the credentials, or if the prefix is invalid.
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
        let host = gethostname::gethostname().to_string_lossy().into_owned();
        let tool = format!(
            "{}@{host}/{}/{:04x}",
            options.tool,
            std::process::id(),
            fastrand::u16(..)
        );
        let mut last = Status::new(tool.clone(), demand.simulation.clone());
        last.state = Activity::Left;
        let mut settings = options.settings.clone();
        settings.will = Some(Will {
            topic: topics.status(&token),
            payload: last.encode(),
            expiry: WILL_EXPIRY,
            retain: false,
        });
        let connection = Connection::open(settings, subscriptions)?;
        let probation = if options.alone {
            Duration::ZERO
        } else {
            PROBATION
        };
        let config = Config {
            demand,
            token: token.clone(),
            parameters: options.parameters,
            tool,
            topics: topics.clone(),
            visual: options.visual,
            timeouts: options.timeouts.clone(),
            faults: options.faults,
            largest: options.largest.max(1),
            probation,
            // Leaves room for 2^52 episodes below 2^53, the limit of exact integers in JSON.
            first_instance: fastrand::u64(..1 << 52),
        };
        let now = Instant::now();
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
            denied: None,
            tick_at: now,
            ask_at: now,
            count_at: now + REPEATS_INTERVAL,
            looked: now,
            probation,
            topics,
            timeouts: options.timeouts,
            events: Vec::new(),
            warnings: Vec::new(),
            reporter: Reporter::default(),
            outages: Outages::default(),
            wall: Wall::new(now),
            load: Load::new(now),
        })
    }

    /// Waits for a fitting server and returns its numbers of sensors and actuators, 0 if no server announces them and
    /// they are not `needed`. Keeps waiting while a fitting server serves another tool. `on_wait` is called ten times a
    /// second with the reason for the wait, and returns false to stop.
    ///
    /// # Errors
    /// Fails if no server fits within the discovery time-out, if the broker denies discovery, if the servers do not
    /// announce their sizes, or if `on_wait` stops the wait.
    pub fn wait_for_server(
        &mut self,
        needed: bool,
        mut on_wait: impl FnMut(&str) -> bool,
    ) -> Result<(usize, usize), PoolError> {
        let start = Instant::now();
        // A server that has just become free still has to answer.
        let mut free_since = start;
        let mut warned = false;
        loop {
            self.poll(Instant::now() + PROGRESS_INTERVAL);
            if let Some(reason) = self.denied.take() {
                return Err(PoolError::Denied(reason));
            }
            if self.scheduler.has_server() {
                // Another server with the same id would answer now, and neither would be used.
                let settled = Instant::now() + self.probation;
                while Instant::now() < settled {
                    self.poll(settled);
                }
            }
            if self.scheduler.has_server() {
                self.scheduler.settle_sizes();
                self.act();
                return match self.scheduler.sizes() {
                    None if needed => Err(match self.scheduler.unknown_size() {
                        Some(size) => WorkError::Unannounced(size).into(),
                        None => PoolError::NoSizes,
                    }),
                    sizes => Ok(sizes.unwrap_or_default()),
                };
            }
            let waited = start.elapsed();
            let busy = self.scheduler.busy_elsewhere();
            if let Some(reason) = &busy {
                free_since = Instant::now();
                if !warned && waited >= self.timeouts.discovery {
                    warned = true;
                    self.warn(format!(
                        "waiting, as {reason}; a server whose tool has ended is free after its --step-timeout (60 s by default); \
                         if the server itself is gone, remove its retained message on {}",
                        self.topics.presence_filter()
                    ));
                }
            } else if self.is_hopeless(free_since, self.timeouts.discovery, Instant::now()) {
                return Err(self.no_server(start, Instant::now()));
            }
            let reason = busy.or_else(|| self.waiting_for_broker(Instant::now()));
            let reason = reason.unwrap_or_else(|| {
                format!("waiting for a server for {:.1} s", waited.as_secs_f64())
            });
            if !on_wait(&reason) {
                return Err(PoolError::Interrupted);
            }
        }
    }

    /// Sets the purpose of the work that follows.
    pub fn set_about(&mut self, about: About) {
        self.supervision
            .set_work(about.generation, about.purpose.as_deref());
        self.about = about;
    }

    /// Declares the processes of these servers supervised. Returns the handle for their supervisor.
    #[must_use]
    pub fn watch(&mut self, servers: impl IntoIterator<Item = u64>) -> Supervision {
        self.scheduler.watch(servers);
        self.supervision.clone()
    }

    /// Returns a handle with which another thread interrupts the wait for messages.
    #[must_use]
    pub fn waker(&self) -> Waker {
        self.connection.waker()
    }

    /// Sets the listener for events.
    pub fn listen(&mut self, listener: Listener) {
        self.reporter = Reporter::new(listener);
    }

    /// Returns the metrics that servers with this simulation announce, sorted.
    #[must_use]
    pub fn metrics(&self) -> Vec<String> {
        self.scheduler.metrics()
    }

    /// Returns the sides of a match that each server with this simulation announces, by id.
    #[must_use]
    pub fn sides(&self) -> Vec<(u64, &[AnnouncedSide])> {
        self.scheduler.sides()
    }

    /// Returns the determinism and the tolerance that each server declares.
    #[must_use]
    pub fn determinism(&self) -> Vec<(u64, Option<&str>, Option<f64>)> {
        self.scheduler.determinism()
    }

    /// Returns the counts of incidents so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.scheduler.counts()
    }

    /// Takes the warnings for the user since the last call.
    pub fn take_warnings(&mut self) -> Vec<Warning> {
        std::mem::take(&mut self.warnings)
    }

    /// Takes the attempts made since the last call.
    pub fn take_journal(&mut self) -> Vec<Attempt> {
        let wall = self.wall;
        let journal = self.scheduler.take_journal().into_iter();
        self.reporter.taken();
        journal
            .map(|(attempt, started)| wall.dated(attempt, started))
            .collect()
    }

    /// Frees the servers and disconnects.
    pub fn close(mut self) {
        self.scheduler.release();
        self.act();
        self.count_alike(Instant::now());
        self.tell(true, Instant::now());
        self.connection.close(Duration::from_secs(1));
    }
}
