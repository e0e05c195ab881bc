//! Control of a running server by other threads: stopping it, or replacing reloaded files.

use crate::access::Access;
use crate::passwords::Users;
use mio::Waker;
use rustls::ServerConfig;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Contents of reloaded files.
pub struct Renewal {
    pub tls: Option<Arc<ServerConfig>>,
    pub users: Option<Users>,
    pub access: Option<Access>,
}

/// A handle that stops a running server from another thread, or replaces its files.
pub struct Stopper {
    pub(super) stop: Arc<AtomicBool>,
    pub(super) renewal: Arc<Mutex<Option<Renewal>>>,
    pub(super) waker: Arc<Waker>,
}

impl Stopper {
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Release);
        self.wake();
    }

    /// Sets the contents that apply from the server's next turn on.
    pub fn renew(&self, renewal: Renewal) {
        *self.renewal.lock().unwrap_or_else(PoisonError::into_inner) = Some(renewal);
        self.wake();
    }

    fn wake(&self) {
        if let Err(error) = self.waker.wake() {
            log::error!("the broker could not be woken: {error}");
        }
    }
}
