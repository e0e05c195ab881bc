//! Servers whose processes are the tool's own: their supervisor knows when and how one ended, and what it was at; the pool
//! knows which one has not answered in time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use swarmwright_mqtt::Waker;

use crate::scheduler::fleet::processes::Ending;

/// Requests that are remembered, for what comes late of them.
const PLACES: usize = 4096;

/// What the pool and the supervisor of the processes tell each other, from any thread.
#[derive(Clone)]
pub struct Supervision {
    shared: Arc<Mutex<Shared>>,
    waker: Waker,
}

#[derive(Default)]
struct Shared {
    endings: Vec<Ending>,
    alive: Vec<u64>,
    overdue: Vec<u64>,
    starting: usize,
    /// By request.
    places: VecDeque<(u64, Place)>,
    generation: Option<u64>,
    purpose: Option<Arc<str>>,
}

/// What a request is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Its first candidate.
    pub candidate: usize,
    /// Its first episode.
    pub episode: usize,
    /// The generation, if the pool was told.
    pub generation: Option<u64>,
    /// What it was sent for, if the pool was told.
    pub purpose: Option<Arc<str>>,
}

impl Supervision {
    pub(crate) fn new(waker: Waker) -> Self {
        Self {
            shared: Arc::default(),
            waker,
        }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A process has ended. To be told before another one is started under its id.
    pub fn ended(&self, ending: Ending) {
        self.shared().endings.push(ending);
        self.waker.wake();
    }

    /// A server of which it was asked goes on computing.
    pub fn is_alive(&self, server: u64) {
        self.shared().alive.push(server);
        self.waker.wake();
    }

    /// Sets the number of servers that are being started; while it is not 0, the pool does not give up for lack of servers.
    pub fn starting(&self, servers: usize) {
        self.shared().starting = servers;
    }

    /// Servers that have not answered in time since the last call; the supervisor must check whether each is alive.
    pub fn take_overdue(&self) -> Vec<u64> {
        std::mem::take(&mut self.shared().overdue)
    }

    /// What a request was about.
    #[must_use]
    pub fn place(&self, request: u64) -> Option<Place> {
        let shared = self.shared();
        let mut places = shared.places.iter().rev();
        places
            .find(|(number, _)| *number == request)
            .map(|(_, address)| address.clone())
    }

    pub(crate) fn are_starting(&self) -> bool {
        self.shared().starting > 0
    }

    pub(crate) fn is_overdue(&self, server: u64) {
        self.shared().overdue.push(server);
    }

    pub(crate) fn sent(&self, request: u64, candidate: usize, episode: usize) {
        let mut shared = self.shared();
        if shared.places.len() >= PLACES {
            shared.places.pop_front();
        }
        let address = Place {
            candidate,
            episode,
            generation: shared.generation,
            purpose: shared.purpose.clone(),
        };
        shared.places.push_back((request, address));
    }

    pub(crate) fn set_work(&self, generation: Option<u64>, purpose: Option<&str>) {
        let mut shared = self.shared();
        (shared.generation, shared.purpose) = (generation, purpose.map(Arc::from));
    }

    pub(crate) fn take(&self) -> (Vec<Ending>, Vec<u64>) {
        let mut shared = self.shared();
        (
            std::mem::take(&mut shared.endings),
            std::mem::take(&mut shared.alive),
        )
    }
}
