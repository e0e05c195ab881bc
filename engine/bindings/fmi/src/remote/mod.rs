//! A simulation behind a broker: the FMU is the optimization tool of one simulation server (D6.1, Figure 10).
//!
//! A server that announces batches is asked for a batch of one episode, whose messages say which agents act; any other one
//! is stepped by the messages of D6.1.

mod batched;
mod finding;
mod link;
mod options;
mod stepwise;

use std::time::{Duration, Instant};

use serde_json::{Map, Value};
use swarmwright_protocol::{Announcement, EpisodeHasher, ServerMessage};
use swarmwright_worlds::Parameters;

use crate::model::Model;
use crate::world::{View, World};

use link::{Link, News};
use options::Options;

/// Time after which another server is chosen if the first has not begun: two tools may choose the same.
const BEGIN: Duration = Duration::from_secs(5);

/// Why an episode does not begin on a server.
enum Refused {
    /// Another tool has the server, or it left: another server may do.
    Taken(String),
    /// It would go no better another time.
    For(String),
}

/// How an episode is stepped.
enum Episode {
    None,
    Batched(batched::Batched),
    Stepwise(stepwise::Stepwise),
}

/// See the module.
pub struct Remote {
    model: Model,
    tool: String,
    /// Of the connection, from the parameters at the start of the episode.
    options: Option<Options>,
    link: Option<Link>,
    server: Option<ServerMessage>,
    episode: Episode,
    /// Steps that were made.
    steps: u64,
    /// Why the episode cannot go on.
    broken: Option<String>,
    view: View,
}

impl Remote {
    /// Nothing is connected yet.
    pub fn new(model: &Model) -> Self {
        let host = gethostname::gethostname().to_string_lossy().into_owned();
        let mut remote = Self {
            tool: format!(
                "fmu@{host}/{}/{:08x}",
                std::process::id(),
                fastrand::u32(..)
            ),
            options: None,
            link: None,
            server: None,
            episode: Episode::None,
            steps: 0,
            broken: None,
            view: View::default(),
            model: model.clone(),
        };
        remote.clear();
        remote
    }

    fn clear(&mut self) {
        let model = &self.model;
        self.view = View {
            sensors: vec![0.0; model.agents * model.sensors],
            acts: vec![false; model.agents],
            metrics: vec![f64::NAN; model.metrics.len()],
            fitness: f64::NAN,
            done: false,
        };
        self.steps = 0;
        self.broken = None;
    }

    /// The connection with these options: the one that is there, if they have not changed and it is not broken.
    fn connect(&mut self, options: &Options) -> Result<(), String> {
        let same = self.options.as_ref() == Some(options);
        let usable = self.link.as_mut().is_some_and(Link::is_usable);
        if same && usable {
            return Ok(());
        }
        self.link = None;
        self.link = Some(Link::open(options)?);
        self.options = Some(options.clone());
        Ok(())
    }

    fn link(&mut self) -> Result<&mut Link, String> {
        self.link.as_mut().ok_or_else(|| "not connected".to_owned())
    }

    fn options(&self) -> Options {
        self.options.clone().unwrap_or_default()
    }

    fn server_id(&self) -> u64 {
        self.server.as_ref().map_or(0, |server| server.server)
    }

    fn announcement(&self) -> Option<&Announcement> {
        self.server.as_ref()?.capabilities.swarmwright.as_ref()
    }

    fn instance(&self) -> Option<String> {
        self.announcement()?.instance.clone()
    }

    /// Looks for servers until one has begun the episode.
    fn start(&mut self, parameters: &Parameters) -> Result<(), String> {
        let options = self.options();
        let begin = Instant::now();
        let mut refusal = None;
        loop {
            let left = options.discovery.saturating_sub(begin.elapsed());
            self.server = Some(self.find(begin, left, refusal.take())?);
            self.fits()?;
            match self.start_on(parameters, &options) {
                Ok(()) => return Ok(()),
                Err(Refused::For(reason)) => return Err(reason),
                Err(Refused::Taken(reason)) => refusal = Some(reason),
            }
        }
    }

    /// Refuses a server that has other variables than the FMU.
    fn fits(&self) -> Result<(), String> {
        let Some(server) = &self.server else {
            return Ok(());
        };
        let Some(announced) = &server.capabilities.swarmwright else {
            return Ok(());
        };
        let (id, model) = (server.server, &self.model);
        for (noun, actual, expected) in [
            ("sensors", announced.sensors, model.sensors),
            ("actuators", announced.actuators, model.actuators),
        ] {
            if let Some(actual) = actual
                && actual != expected
            {
                return Err(format!(
                    "server {id} offers {actual} {noun} per agent, but the FMU has variables for {expected}; export it again for \
                     this simulation (swarmwright export-fmu --proxy)"
                ));
            }
        }
        match model
            .metrics
            .iter()
            .find(|name| !announced.metrics.contains(name))
        {
            None => Ok(()),
            Some(missing) => Err(format!(
                "server {id} does not measure {missing:?}, but the FMU has a variable metrics.{missing}; export it again for \
                 this simulation (swarmwright export-fmu --proxy)"
            )),
        }
    }

    fn start_on(&mut self, parameters: &Parameters, options: &Options) -> Result<(), Refused> {
        let modes = self.server.as_ref().and_then(|server| {
            let announced = server.capabilities.swarmwright.as_ref()?;
            Some(announced.modes.clone())
        });
        let patience = options.step.min(BEGIN);
        if modes.is_some_and(|modes| modes.iter().any(|mode| mode == "batched")) {
            self.start_batch(parameters, patience)
        } else {
            self.start_stepwise(parameters, patience)
        }
    }

    /// Creates unique hashes for the discovery and for the episode.
    fn hashes(&self, parameters: &Map<String, Value>) -> [String; 2] {
        let title = self
            .options
            .as_ref()
            .map_or(self.model.title.as_str(), |options| &options.simulation);
        let hasher = EpisodeHasher::new(title, parameters);
        let first = fastrand::u64(..1 << 52);
        [hasher.hash(first), hasher.hash(first + 1)]
    }

    /// Waits for news of the episode until a time; none when it has come.
    fn news(&mut self, until: Instant) -> Result<Option<News>, String> {
        let (id, instance, steps) = (self.server_id(), self.instance(), self.steps);
        loop {
            let url = self.link()?.url.clone();
            match self.link()?.next(until) {
                None => return Ok(None),
                Some(News::Disconnected(reason)) => {
                    return Err(format!(
                        "the connection to the broker at {url} broke after step {steps}: {reason}"
                    ));
                }
                Some(News::Unsent(reason) | News::Unread(reason)) => return Err(reason),
                Some(News::Gone(server, gone_instance)) => {
                    if server == id && (gone_instance.is_none() || gone_instance == instance) {
                        return Err(format!("server {id} was lost after step {steps}"));
                    }
                }
                Some(news) => return Ok(Some(news)),
            }
        }
    }

    fn silent(&self, problem: &str) -> String {
        format!(
            "server {} {problem} for {} s after step {} (connection.stepTimeout)",
            self.server_id(),
            self.options().step.as_secs_f64(),
            self.steps
        )
    }

    /// What an agent senses. Refuses agents and sensors that the FMU has no variables of.
    fn sensed(&mut self, agent: usize, values: &[f32]) -> Result<(), String> {
        let (id, model) = (self.server_id(), &self.model);
        if agent >= model.agents {
            return Err(format!(
                "server {id} has an agent {agent} (counted from 0), but the FMU has variables for {} agents; export it again \
                 with these parameters (swarmwright export-fmu --proxy --set) or with --agents",
                model.agents
            ));
        }
        if values.len() != model.sensors {
            return Err(format!(
                "server {id}: agent {agent} has {} sensors, but the FMU has variables for {}; export it again for this \
                 simulation (swarmwright export-fmu --proxy)",
                values.len(),
                model.sensors
            ));
        }
        self.view.acts[agent] = true;
        self.view.sensors[agent * model.sensors..(agent + 1) * model.sensors]
            .copy_from_slice(values);
        Ok(())
    }

    /// Ends the episode with its fitness and metrics.
    fn ended(&mut self, fitness: f64, metric: impl Fn(&str) -> Option<f64>) -> Result<(), String> {
        let id = self.server_id();
        for (name, value) in self.model.metrics.iter().zip(&mut self.view.metrics) {
            *value = metric(name).ok_or_else(|| {
                format!("server {id} sent no metric {name:?} at the end of the episode")
            })?;
        }
        self.view.fitness = fitness;
        self.view.done = true;
        self.view.acts.fill(false);
        self.episode = Episode::None;
        Ok(())
    }

    /// The server need not wait any more.
    fn release(&mut self) {
        let id = self.server_id();
        let episode = std::mem::replace(&mut self.episode, Episode::None);
        if self.server.is_some() && self.link.is_some() {
            if let Episode::Batched(batch) = &episode {
                let _ = self.end_batch(batch);
            }
            let hash = match &episode {
                Episode::Stepwise(stepwise) => stepwise.hash.clone(),
                _ => self.hashes(&Map::new())[0].clone(),
            };
            let _ = self.control(id, hash, false, None);
        }
        self.server = None;
    }
}

impl World for Remote {
    fn begin(&mut self, parameters: &Parameters, connection: &Parameters) -> Result<(), String> {
        self.release();
        self.clear();
        let options = Options::read(connection)?;
        self.connect(&options)?;
        let begun = self.start(parameters);
        if begun.is_err() {
            self.release();
        }
        begun
    }

    fn step(&mut self, actuators: &[f32]) -> Result<(), String> {
        if let Some(reason) = &self.broken {
            return Err(format!("{reason}; reset the FMU for another episode"));
        }
        let stepped = match self.episode {
            Episode::None => Ok(()),
            Episode::Batched(_) => self.step_batch(actuators),
            Episode::Stepwise(_) => self.step_stepwise(actuators),
        };
        match stepped {
            Ok(()) => self.steps += 1,
            Err(reason) => {
                self.release();
                self.broken = Some(reason.clone());
                return Err(reason);
            }
        }
        Ok(())
    }

    fn view(&self) -> &View {
        &self.view
    }

    fn end(&mut self) {
        self.release();
    }

    fn goes_back(&self) -> bool {
        false
    }
}
