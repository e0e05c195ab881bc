//! The schedule of a simulation: its parties, the work to compute, and the faults with their times.

mod display;

use serde::{Deserialize, Serialize};

/// Microseconds since the start.
pub type Time = u64;

/// A second.
pub const SECOND: Time = 1_000_000;
/// A millisecond.
pub const MILLI: Time = 1_000;

/// After this time of silence a broker gives up a connection (1.5 times the keep-alive of 30 s), and publishes its last will.
pub const BROKER_PATIENCE: Time = 45 * SECOND;
/// After this time of silence a client gives up a connection: a ping after 30 s, no answer for 20 s.
pub const CLIENT_PATIENCE: Time = 50 * SECOND;

/// Number of lost servers after which a candidate is in quarantine.
const MANY_LOSSES: usize = 3;

/// So many failures may be enough for a candidate to be believed to fail.
const FEW_ATTEMPTS: usize = 2;
/// What lasts so long lasts as long as the simulation.
pub const FOR_GOOD: Time = 200 * SECOND;

/// All that there is to know of a simulation: the same schedule gives the same events.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Schedule {
    /// Of the latencies, and of which messages a disturbance hits.
    pub seed: u64,
    /// The optimization tools.
    pub tools: Vec<Tool>,
    /// The simulation servers; the id is the index and 1.
    pub servers: Vec<Server>,
    /// The faults.
    pub disturbances: Vec<Disturbance>,
}

/// An optimization tool.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tool {
    /// When it starts.
    pub joins: Time,
    /// auto, stepwise, batched or offloaded.
    pub mode: String,
    /// How often an evaluation is tried.
    pub attempts: u32,
    /// How long a server may be silent in an episode.
    pub step_timeout: Time,
    /// What it has computed, one after another.
    pub works: Vec<Work>,
}

/// What controls the agents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A network without state.
    Layered,
    /// A network with state: a step that is made twice, or missed, changes the fitness.
    FullyMeshed,
    /// Agents that steer themselves by parameters.
    ParameterSet,
}

/// Candidates to evaluate.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// Of the controllers.
    pub kind: Kind,
    /// Number of candidates.
    pub candidates: usize,
    /// Episodes of each.
    pub episodes: usize,
    /// How many candidates are under way at once where they are handed over one by one; none for all at once.
    pub window: Option<usize>,
    /// Candidates that the simulation gives up.
    pub failing: Vec<usize>,
    /// Candidates that bring the whole server down.
    pub deadly: Vec<usize>,
    /// How long the tool thinks before it hands them over.
    pub pause: Time,
}

/// A simulation server.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Server {
    /// When it starts.
    pub joins: Time,
    /// How long it computes a step of an episode.
    pub pace: Time,
    /// How long it waits for actuators.
    pub patience: Time,
    /// Whether it knows only the seven topics of D6.1.
    pub plain: bool,
    /// Another server's id that it has, on another machine; none for its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub twin: Option<Twin>,
}

/// A server that has the id of another one, and starts if that one seems to have ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Twin {
    /// The id.
    pub id: u64,
    /// Whether it offers another simulation.
    pub foreign: bool,
}

/// A party, by its index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// An optimization tool.
    Tool(usize),
    /// A simulation server.
    Server(usize),
}

/// Something that goes wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Disturbance {
    /// When it begins.
    pub at: Time,
    /// How long it lasts; 0 where that means nothing.
    pub lasts: Time,
    /// What it is.
    pub what: What,
}

/// What a broker that was restarted knows of retained messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Memory {
    /// All.
    Kept,
    /// Those of half the time before, as after a kill between two savings.
    Stale,
    /// None.
    Lost,
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A connection is reset; both ends see it, and what is under way is lost.
    Cut(Who),
    /// Nothing goes through between a party and the broker.
    Partition(Who),
    /// A server's process dies and is started anew later, with another instance.
    Crash {
        /// Which.
        server: usize,
        /// Whether the computer dies with it, so that the broker does not see the connection end.
        power: bool,
    },
    /// A server leaves in good order and comes back later.
    Leave(usize),
    /// A process is stopped and goes on later (SIGSTOP and SIGCONT, a laptop that sleeps).
    Freeze(Who),
    /// The broker dies and restarts later.
    Broker(Memory),
    /// An optimization tool is killed and started anew later; it has its unfinished work computed again.
    Restart(usize),
    /// An optimization tool gives up what is under way and begins it again.
    Interrupt(usize),
    /// Messages from and to a party are lost.
    Lose {
        /// The affected party.
        party: Who,
        /// How many of 100.
        percent: u64,
    },
    /// Messages from and to a party come twice.
    Duplicate {
        /// The affected party.
        party: Who,
        /// How many of 100.
        percent: u64,
        /// How much later the second one comes, at most.
        later: Time,
    },
    /// Messages from and to a party overtake each other.
    Reorder {
        /// The affected party.
        party: Who,
        /// How many of 100.
        percent: u64,
        /// Largest delay of their arrival.
        later: Time,
    },
    /// Messages from and to a party overtake those on other topics, as with brokers that keep the order within a topic
    /// only.
    Cross {
        /// The affected party.
        party: Who,
        /// How many of 100.
        percent: u64,
        /// Largest delay of their arrival.
        later: Time,
    },
    /// Messages from and to a party take longer.
    Delay {
        /// The affected party.
        party: Who,
        /// Additional time.
        by: Time,
    },
    /// A server's installation is broken: everything fails on it at once.
    Break(usize),
    /// A server computes more slowly.
    Slow {
        /// Which.
        server: usize,
        /// Factor of the slowdown.
        times: u64,
    },
}

impl Disturbance {
    /// When all is well again.
    #[must_use]
    pub fn end(&self) -> Time {
        self.at + self.lasts
    }

    /// Whether it does what MQTT over TCP never does: single messages are lost, doubled or overtaken.
    #[must_use]
    pub fn is_harsh(&self) -> bool {
        matches!(
            self.what,
            What::Lose { .. } | What::Duplicate { .. } | What::Reorder { .. }
        )
    }

    /// Whether messages take longer while it lasts.
    #[must_use]
    pub fn delays(&self) -> bool {
        matches!(self.what, What::Delay { .. })
    }

    /// Whether it may look to a tool with this time-out as if a candidate were to blame. `server`: the one that it hits.
    fn incriminates(&self, step_timeout: Time, server: Option<&Server>) -> bool {
        match self.what {
            // An episode that takes longer than the time-out fails every time.
            What::Slow { times, .. } => {
                server.is_some_and(|server| 5 * server.pace * times >= step_timeout)
            }
            What::Lose { .. } | What::Reorder { .. } => true,
            _ => false,
        }
    }

    /// Whether a server seems to be gone while it lasts.
    fn loses_a_server(&self) -> bool {
        matches!(
            self.what,
            What::Crash { .. }
                | What::Partition(Who::Server(_))
                | What::Freeze(Who::Server(_))
                | What::Cut(Who::Server(_))
        )
    }

    /// The affected party; `None` for the broker.
    #[must_use]
    pub fn who(&self) -> Option<Who> {
        Some(match self.what {
            What::Cut(party)
            | What::Partition(party)
            | What::Freeze(party)
            | What::Lose { party, .. }
            | What::Duplicate { party, .. }
            | What::Reorder { party, .. }
            | What::Cross { party, .. }
            | What::Delay { party, .. } => party,
            What::Crash { server, .. }
            | What::Leave(server)
            | What::Break(server)
            | What::Slow { server, .. } => Who::Server(server),
            What::Restart(tool) | What::Interrupt(tool) => Who::Tool(tool),
            What::Broker(_) => return None,
        })
    }
}

impl Schedule {
    /// The id of a server.
    #[must_use]
    pub fn id(&self, server: usize) -> u64 {
        let twin = self.servers.get(server).and_then(|server| server.twin);
        twin.map_or(server as u64 + 1, |twin| twin.id)
    }

    /// Whether another server may have the id of this one.
    #[must_use]
    pub fn has_twin(&self, server: usize) -> bool {
        let others = (0..self.servers.len()).filter(|other| *other != server);
        others
            .into_iter()
            .any(|other| self.id(other) == self.id(server))
    }

    /// Whether a sound candidate of a tool may be reported failed: where messages are lost, it cannot be told why a server
    /// does not answer.
    #[must_use]
    pub fn may_fail(&self, tool: &Tool) -> bool {
        let incriminates = |disturbance: &Disturbance| {
            let server = match disturbance.who() {
                Some(Who::Server(server)) => self.servers.get(server),
                _ => None,
            };
            disturbance.incriminates(tool.step_timeout, server)
        };
        // Without a second server, nothing shows that a candidate with which servers are lost repeatedly is valid.
        let losses = self
            .disturbances
            .iter()
            .filter(|disturbance| disturbance.loses_a_server());
        let first = self.id(0);
        let alone = (0..self.servers.len()).all(|server| self.id(server) == first);
        let single = alone && losses.count() >= MANY_LOSSES;
        // What a server failed while it was broken for a moment counts once, as it succeeds before and afterwards.
        let breaks = |disturbance: &&Disturbance| {
            matches!(disturbance.what, What::Break(_)) && disturbance.lasts < FOR_GOOD
        };
        let moments = self.disturbances.iter().filter(breaks).count();
        single || moments >= FEW_ATTEMPTS || self.disturbances.iter().any(incriminates)
    }

    /// Whether servers may fail with any work.
    #[must_use]
    pub fn may_break(&self) -> bool {
        let mut events = self.disturbances.iter().map(|disturbance| disturbance.what);
        events.any(|event| matches!(event, What::Break(_)))
    }

    /// Whether work may end without results, to be resumed: where servers are broken, or lost again and again.
    #[must_use]
    pub fn may_end(&self) -> bool {
        let mut works = self.tools.iter().flat_map(|tool| &tool.works);
        let mut events = self.disturbances.iter().map(|disturbance| disturbance.what);
        // A server that knows only the seven topics cannot say that a candidate failed.
        let plain = self.servers.iter().any(|server| server.plain);
        works.any(|work| !work.deadly.is_empty() || (plain && !work.failing.is_empty()))
            || events.any(|event| {
                matches!(
                    event,
                    What::Break(_)
                        | What::Lose { .. }
                        | What::Reorder { .. }
                        | What::Crash { .. }
                        | What::Leave(_)
                        | What::Freeze(_)
                        | What::Partition(_)
                        | What::Slow { .. }
                )
            })
    }

    /// When the last disturbance has ended and all parties are there.
    #[must_use]
    pub fn calm(&self) -> Time {
        let ends = self.disturbances.iter().map(Disturbance::end);
        let joins = self.servers.iter().map(|server| server.joins);
        let tools = self.tools.iter().map(|tool| tool.joins);
        ends.chain(joins).chain(tools).max().unwrap_or(0)
    }
}
