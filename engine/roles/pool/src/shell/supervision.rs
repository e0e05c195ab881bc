//! Exchange between the pool and the supervisor of its servers' processes: the supervisor knows when and how a process
//! ended and what it was computing; the pool knows which server has not answered in time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use swarmwright_mqtt::Waker;

use crate::scheduler::fleet::processes::Ending;

/// Number of requests that are remembered, for late reports about them.
const PLACES: usize = 4096;

/// Channel between the pool and the supervisor, usable from any thread.
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
    /// Places of recent requests, by number.
    places: VecDeque<(u64, Place)>,
    generation: Option<u64>,
    purpose: Option<Arc<str>>,
}

/// Contents of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// First candidate.
    pub candidate: usize,
    /// First episode.
    pub episode: usize,
    /// Generation, if the pool was told.
    pub generation: Option<u64>,
    /// Purpose of the work, if the pool was told.
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

    /// Reports that a process has ended. Must be called before another one is started with the same id.
    pub fn ended(&self, ending: Ending) {
        self.shared().endings.push(ending);
        self.waker.wake();
    }

    /// Reports that an overdue server is still computing.
    pub fn is_alive(&self, server: u64) {
        self.shared().alive.push(server);
        self.waker.wake();
    }

    /// Sets the number of servers that are being started; while it is not 0, the pool does not give up for lack of servers.
    pub fn starting(&self, servers: usize) {
        self.shared().starting = servers;
    }

    /// Takes the servers that have not answered in time since the last call; the supervisor must check whether each is
    /// alive.
    pub fn take_overdue(&self) -> Vec<u64> {
        std::mem::take(&mut self.shared().overdue)
    }

    /// Returns the contents of a request.
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
