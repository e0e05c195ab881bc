//! Probes the broker's handling of small packets in a separate thread, while the run continues.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use swarmwright_mqtt::{Settings, Waker, holds_back_small_packets};

/// Whether the broker holds small packets back, or why the probe failed.
type Answer = Result<bool, String>;

/// A probe that keeps its answer until it is taken.
pub(crate) struct Probe {
    settings: Settings,
    waker: Waker,
    answer: Arc<Mutex<Option<Answer>>>,
}

impl Probe {
    pub fn new(settings: Settings, waker: Waker) -> Self {
        Self {
            settings,
            waker,
            answer: Arc::default(),
        }
    }

    /// Starts the probe. Its thread ends after the settings' time-outs at the latest.
    pub fn ask(&self) {
        let (settings, waker, answer) = (
            self.settings.clone(),
            self.waker.clone(),
            self.answer.clone(),
        );
        let asking = thread::Builder::new().name("broker-probe".to_owned());
        let thread = asking.spawn(move || {
            let result = holds_back_small_packets(&settings).map_err(|error| error.to_string());
            *answer.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            waker.wake();
        });
        if let Err(error) = thread {
            log::debug!("cannot ask the broker: {error}");
        }
    }

    /// Takes the answer.
    pub fn take(&self) -> Option<Answer> {
        let mut answer = self.answer.lock().unwrap_or_else(PoisonError::into_inner);
        answer.take()
    }
}
