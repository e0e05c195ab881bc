//! A server whose simulation's functions we call: in a loop of ours, or whenever the caller polls.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use swarmwright_kernels::PhysicsSimulation;
use swarmwright_worlds::Simulation;
use swarmwright_wrapper::{Options, ServeError, SimulationServer};

use crate::callbacks::{self, RawSimulation};
use crate::description::{self, RawDescription};
use crate::error::{Trouble, shield};
use crate::foreign::Foreign;
use crate::input;
use crate::live::{Live, is_inside};
use crate::options::{self, Listener, RawOptions, seconds};
use crate::physics::{self, RawPhysics};

/// How often a server that runs looks whether it is to stop.
const TURN: Duration = Duration::from_millis(100);

/// `swarmwright_server`.
pub struct Server {
    /// None once it has left the broker.
    server: Mutex<Option<SimulationServer>>,
    stop: AtomicBool,
    listener: Listener,
    live: Arc<Live>,
}

// SAFETY: its listener's pointer is only handed to the listener, on the thread that has the lock.
unsafe impl Sync for Server {}

impl Server {
    fn lock(&self) -> Result<MutexGuard<'_, Option<SimulationServer>>, Trouble> {
        if is_inside() {
            return Err(Trouble::invalid(
                "a function of the simulation cannot run, poll or close servers; call swarmwright_server_stop instead",
            ));
        }
        match self.server.try_lock() {
            Ok(server) => Ok(server),
            Err(TryLockError::Poisoned(server)) => Ok(server.into_inner()),
            Err(TryLockError::WouldBlock) => Err(Trouble::invalid(
                "another thread runs or polls the server; stop it, and wait until it has returned",
            )),
        }
    }

    fn poll(&self, patience: Duration) -> Result<(), Trouble> {
        let mut server = self.lock()?;
        let Some(server) = server.as_mut() else {
            return Err(Trouble::invalid("the server has left the broker"));
        };
        server
            .poll(patience, |notice| self.listener.tell(notice))
            .map_err(trouble)
    }

    /// Leaves the broker, and waits until the simulations are dropped.
    fn leave(&self) -> Result<(), Trouble> {
        if let Some(server) = self.lock()?.take() {
            server.close();
        }
        self.live.wait_for_none();
        Ok(())
    }
}

/// What the wrapper says when it cannot serve.
pub(crate) fn trouble(error: ServeError) -> Trouble {
    match error {
        ServeError::Topic(_) | ServeError::NoSimulation => Trouble::Invalid(error.to_string()),
        ServeError::Connect(_)
        | ServeError::IdTaken { .. }
        | ServeError::IdLost { .. }
        | ServeError::Unannounced(_) => Trouble::Failed(error.to_string()),
    }
}

/// Connects to the broker and offers a simulation.
///
/// # Safety
/// The pointers are null or point to what the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_server_open(
    options: *const RawOptions,
    description: *const RawDescription,
    simulation: *const RawSimulation,
    server: *mut *mut Server,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let ((options, listener), table) = unsafe {
            let description = description::read(description)?;
            (
                options::read(options)?,
                callbacks::read(simulation, description)?,
            )
        };
        let first = Box::new(Foreign::new(&table)?);
        // SAFETY: as the caller promises.
        unsafe { open(first, table.live(), (options, listener), server) }
    })
}

/// Connects to the broker, offers a mission's simulation that the caller's simulator moves.
///
/// # Safety
/// The pointers are null or point to what the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_server_open_physics(
    options: *const RawOptions,
    physics: *const RawPhysics,
    server: *mut *mut Server,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let ((options, listener), (kind, live)) =
            unsafe { (options::read(options)?, physics::read(physics)?) };
        if options.threads != 1 {
            return Err(Trouble::invalid(format!(
                "threads: {} found, but missions in other simulators are evaluated by one thread; start more servers",
                options.threads
            )));
        }
        let first = PhysicsSimulation::new(Arc::new(kind)).map_err(Trouble::Failed)?;
        // SAFETY: as the caller promises.
        unsafe { open(Box::new(first), live, (options, listener), server) }
    })
}

/// Connects a simulation, and gives the server out.
///
/// # Safety
/// `server` is null or may be written to.
unsafe fn open(
    first: Box<dyn Simulation>,
    live: Arc<Live>,
    (options, listener): (Options, Listener),
    server: *mut *mut Server,
) -> Result<(), Trouble> {
    let opened = SimulationServer::connect(vec![first], options).map_err(trouble)?;
    let opened = Box::into_raw(Box::new(Server {
        server: Mutex::new(Some(opened)),
        stop: AtomicBool::new(false),
        listener,
        live,
    }));
    // SAFETY: as the caller promises; values that cannot be returned are freed.
    unsafe {
        input::write("the pointer for the server", server, opened)
            .inspect_err(|_| drop(Box::from_raw(opened)))
    }
}

/// Serves until it is stopped, then leaves the broker.
///
/// # Safety
/// `server` is null or an open server.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_server_run(server: *const Server) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let server = unsafe { input::object("the server", server)? };
        let mut served = Ok(());
        while served.is_ok() && !server.stop.load(Ordering::Relaxed) {
            served = server.poll(TURN);
        }
        server.leave()?;
        served
    })
}

/// One turn: waits for at most so many seconds for something to happen, and does what is due.
///
/// # Safety
/// As `swarmwright_server_run`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_server_poll(server: *const Server, patience: f64) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let server = unsafe { input::object("the server", server)? };
        server.poll(seconds("the time to wait", patience)?)
    })
}

/// Makes `swarmwright_server_run` return soon; from any thread, any callback, or a signal handler.
///
/// # Safety
/// As `swarmwright_server_run`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_server_stop(server: *const Server) {
    // Nothing but a store, for signal handlers.
    // SAFETY: as the caller promises.
    if let Some(server) = unsafe { server.as_ref() } {
        server.stop.store(true, Ordering::Relaxed);
    }
}

/// Gives up what is under way, leaves the broker, destroys all simulations and frees the server; null is nothing to do.
///
/// # Safety
/// `server` is null or an open server, which no other thread uses any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_server_close(server: *mut Server) -> i32 {
    shield(|| {
        if server.is_null() {
            return Ok(());
        }
        // SAFETY: as the caller promises.
        unsafe { input::object("the server", server)? }.leave()?;
        // SAFETY: it was made by `swarmwright_server_open`, and it is not used any more.
        drop(unsafe { Box::from_raw(server) });
        Ok(())
    })
}
