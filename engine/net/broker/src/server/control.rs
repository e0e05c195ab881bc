//! What other threads tell a running server: to stop, or to use files that were read again.

use crate::access::Access;
use crate::passwords::Users;
use mio::Waker;
use rustls::ServerConfig;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Files that were read again.
pub struct Renewal {
    pub tls: Option<Arc<ServerConfig>>,
    pub users: Option<Users>,
    pub access: Option<Access>,
}

/// Ends a running server from another thread, or gives it other files.
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

    /// What is in force from the server's next turn on.
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
