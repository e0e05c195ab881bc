//! Where a server and a simulator with a loop of its own meet: the server asks and waits, the simulator looks in.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use swarmwright_worlds::{ParameterError, Parameters};
use swarmwright_wrapper::Notice;

use crate::error::Trouble;

/// What the server wants.
#[derive(Debug)]
pub(crate) enum Request {
    /// An episode is to begin.
    Reset(Box<Parameters>),
    /// Actuators of the named agents.
    Step(Vec<f32>),
}

/// What the simulator says.
#[derive(Debug)]
pub(crate) enum Answer {
    /// These agents act next, and sense this.
    Sensed { agents: Vec<u32>, sensors: Vec<f32> },
    /// The episode has ended.
    Ended { fitness: f64, metrics: Vec<f64> },
    /// A parameter cannot be used.
    Refused(ParameterError),
    /// The episode cannot go on.
    Failed(String),
}

/// What the simulator is at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// There is no episode.
    Idle,
    /// It was asked, and is to answer.
    Due,
    /// It has sent the agents' sensors, and waits for their actuators.
    Waiting,
}

/// What the simulator learns when it looks in.
#[derive(Debug)]
pub(crate) enum News {
    Nothing,
    Asked(Request),
    /// The episode that it waits in is over.
    Abandoned,
}

#[derive(Debug)]
struct State {
    phase: Phase,
    request: Option<Request>,
    answer: Option<Answer>,
    abandoned: bool,
    closed: bool,
    notices: VecDeque<Notice>,
}

/// The meeting place.
#[derive(Debug)]
pub(crate) struct Relay {
    state: Mutex<State>,
    for_simulator: Condvar,
    for_server: Condvar,
}

/// Largest number of notices that are kept for a simulator that does not poll.
const MOST_NOTICES: usize = 1000;

impl Relay {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            state: Mutex::new(State {
                phase: Phase::Idle,
                request: None,
                answer: None,
                abandoned: false,
                closed: false,
                notices: VecDeque::new(),
            }),
            for_simulator: Condvar::new(),
            for_server: Condvar::new(),
        })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The server asks, and waits for the answer.
    ///
    /// # Errors
    /// The simulator is closed; a step of an episode that was given up.
    pub(crate) fn ask(&self, request: Request) -> Result<Answer, String> {
        let mut state = self.lock();
        if matches!(request, Request::Step(_)) && state.phase != Phase::Waiting {
            return Err("the episode was given up".to_owned());
        }
        // An answer that was not waited for does not answer this.
        state.answer = None;
        state.abandoned = false;
        state.request = Some(request);
        self.for_simulator.notify_all();
        loop {
            if state.closed {
                return Err("the simulator was closed".to_owned());
            }
            if let Some(answer) = state.answer.take() {
                return Ok(answer);
            }
            state = self
                .for_server
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Handles a notice of the server. If it is free, no episode is in progress.
    pub(crate) fn tell(&self, notice: &Notice) {
        let mut state = self.lock();
        if *notice == Notice::Ready && state.phase == Phase::Waiting {
            state.abandoned = true;
        }
        if state.notices.len() < MOST_NOTICES {
            state.notices.push_back(notice.clone());
        }
        self.for_simulator.notify_all();
    }

    /// Called by the simulator; waits at most until `until`, and not at all if the simulator has to answer.
    pub(crate) fn look(&self, until: Instant) -> (News, Vec<Notice>) {
        let mut state = self.lock();
        loop {
            let notices: Vec<Notice> = state.notices.drain(..).collect();
            if let Some(request) = state.request.take() {
                state.phase = Phase::Due;
                return (News::Asked(request), notices);
            }
            if std::mem::take(&mut state.abandoned) && state.phase == Phase::Waiting {
                state.phase = Phase::Idle;
                return (News::Abandoned, notices);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || state.phase == Phase::Due || !notices.is_empty() {
                return (News::Nothing, notices);
            }
            state = self
                .for_simulator
                .wait_timeout(state, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    /// The simulator answers.
    ///
    /// # Errors
    /// It was not asked for.
    pub(crate) fn answer(&self, answer: Answer) -> Result<(), Trouble> {
        let mut state = self.lock();
        if state.phase != Phase::Due {
            return Err(Trouble::invalid(match state.phase {
                Phase::Waiting => {
                    "the actuators of the agents have not arrived; poll until they have"
                }
                _ => "no episode is running; poll until one begins",
            }));
        }
        state.phase = match answer {
            Answer::Sensed { .. } => Phase::Waiting,
            _ => Phase::Idle,
        };
        state.answer = Some(answer);
        self.for_server.notify_all();
        Ok(())
    }

    /// The simulator goes.
    pub(crate) fn close(&self) {
        self.lock().closed = true;
        self.for_server.notify_all();
        self.for_simulator.notify_all();
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.lock().closed
    }
}
