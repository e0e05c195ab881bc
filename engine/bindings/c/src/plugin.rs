//! A simulator that keeps its own loop, as plug-ins of simulators do: it polls for what to do next. The
//! server runs in a separate thread.

mod relay;
mod relayed;
#[cfg(test)]
mod tests;

use std::ffi::c_char;
use std::ptr::null;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, TryLockError};
use std::thread::{self, JoinHandle};
use std::time::Instant;

use swarmwright_worlds::{Description, ParameterError, Parameters};
use swarmwright_wrapper::{Notice, SimulationServer};

use crate::description::{self, RawDescription};
use crate::error::{Trouble, shield};
use crate::foreign::{check_agents, seed};
use crate::input::{self, Structure};
use crate::live::{inside, is_inside};
use crate::options::{self, Listener, RawOptions, seconds};
use crate::parameters::ParameterHandle;
use crate::server::trouble;
use relay::{Answer, News, Relay, Request};
use relayed::Relayed;

/// `swarmwright_event`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawEvent {
    size: usize,
    kind: i32,
    parameters: *const ParameterHandle<'static>,
    seed: u64,
    actuators: *const f32,
    count: usize,
}

// SAFETY: as `Structure` asks.
unsafe impl Structure for RawEvent {
    const NAME: &'static str = "swarmwright_event";
}

/// The data of the last event, as long as it points to them.
#[derive(Default)]
struct EventData {
    /// Before what it points to, so that it goes first.
    given: Option<Box<ParameterHandle<'static>>>,
    parameters: Option<Box<Parameters>>,
    actuators: Vec<f32>,
}

// SAFETY: its cells are used by the thread that polls; the pointer in it is to what stands beside it.
unsafe impl Send for EventData {}

/// `swarmwright_plugin`.
pub struct Plugin {
    relay: Arc<Relay>,
    event: Mutex<EventData>,
    description: Description,
    listener: Listener,
    /// Why the server has left the broker by itself, if it has.
    left: Arc<OnceLock<String>>,
    thread: Option<JoinHandle<()>>,
}

// SAFETY: its listener's pointer is only handed to the listener, on the thread that polls.
unsafe impl Sync for Plugin {}

impl Plugin {
    fn open(
        options: swarmwright_wrapper::Options,
        listener: Listener,
        description: Description,
    ) -> Result<Self, Trouble> {
        let relay = Relay::new();
        let simulation = Relayed::new(Arc::clone(&relay), description.clone());
        let server =
            SimulationServer::connect(vec![Box::new(simulation)], options).map_err(trouble)?;
        let shared = Arc::clone(&relay);
        let left = Arc::new(OnceLock::new());
        let leaves = Arc::clone(&left);
        let serve = move || {
            let served = server.run(|notice| shared.tell(notice), || !shared.is_closed());
            if let Err(error) = served {
                let text = error.to_string();
                let _ = leaves.set(text.clone());
                // A polling simulator wakes up, and finds it.
                shared.tell(&Notice::Warning(text));
            }
        };
        let thread = thread::Builder::new()
            .name("simulation-server".to_owned())
            .spawn(serve)
            .map_err(|error| {
                Trouble::Failed(format!("could not start a thread for the server: {error}"))
            })?;
        Ok(Self {
            relay,
            event: Mutex::default(),
            description,
            listener,
            left,
            thread: Some(thread),
        })
    }

    fn lock_event(&self) -> Result<MutexGuard<'_, EventData>, Trouble> {
        match self.event.try_lock() {
            Ok(guard) => Ok(guard),
            Err(TryLockError::Poisoned(guard)) => Ok(guard.into_inner()),
            Err(TryLockError::WouldBlock) => Err(Trouble::invalid(
                "another thread polls; a plug-in is used by one thread at a time",
            )),
        }
    }

    fn poll(&self, patience: f64, event: &mut RawEvent) -> Result<(), Trouble> {
        let until = Instant::now() + seconds("the time to wait", patience)?;
        let mut state = self.lock_event()?;
        let (news, notices) = self.relay.look(until);
        for notice in &notices {
            inside(|| self.listener.tell(notice));
        }
        if let Some(text) = self.left.get() {
            return Err(Trouble::Failed(text.clone()));
        }
        *event = RawEvent {
            size: event.size,
            kind: 0,
            parameters: null(),
            seed: 0,
            actuators: null(),
            count: 0,
        };
        match news {
            News::Nothing => {}
            News::Asked(Request::Reset(parameters)) => {
                event.kind = 1;
                event.seed = seed(&parameters)?;
                event.parameters = state.keep(parameters);
            }
            News::Asked(Request::Step(actuators)) => {
                event.kind = 2;
                state.actuators = actuators;
                event.actuators = state.actuators.as_ptr();
                event.count = state.actuators.len();
            }
            News::Abandoned => event.kind = 3,
        }
        Ok(())
    }

    fn sense(&self, agents: &[u32], sensors: &[f32]) -> Result<(), Trouble> {
        check_agents(agents, self.description.max_agents).map_err(|trouble| match trouble {
            Trouble::Failed(text) => Trouble::Invalid(text),
            other => other,
        })?;
        self.relay.answer(Answer::Sensed {
            agents: agents.to_vec(),
            sensors: sensors.to_vec(),
        })
    }
}

impl EventData {
    fn keep(&mut self, parameters: Box<Parameters>) -> *const ParameterHandle<'static> {
        self.given = None;
        let parameters = &**self.parameters.insert(parameters);
        // SAFETY: boxed, so that it stays where it is; `given` is dropped before it, here and at the end.
        let parameters: &'static Parameters = unsafe { &*std::ptr::from_ref(parameters) };
        &raw const **self
            .given
            .insert(Box::new(ParameterHandle::new(parameters)))
    }
}

impl Drop for Plugin {
    fn drop(&mut self) {
        self.relay.close();
        if let Some(thread) = self.thread.take() {
            // Whatever it ended with, it has ended.
            let _ = thread.join();
        }
    }
}

/// Connects to the broker and offers the simulator.
///
/// # Safety
/// The pointers are null or point to what the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_open(
    options: *const RawOptions,
    description: *const RawDescription,
    plugin: *mut *mut Plugin,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (description, (options, listener)) =
            unsafe { (description::read(description)?, options::read(options)?) };
        let opened = Box::into_raw(Box::new(Plugin::open(options, listener, description)?));
        // SAFETY: as the caller promises; values that cannot be returned are freed.
        unsafe {
            input::write("the pointer for the plug-in", plugin, opened)
                .inspect_err(|_| drop(Box::from_raw(opened)))
        }
    })
}

/// Returns what to do next; waits at most this many seconds for it.
///
/// # Safety
/// `plugin` is null or an open plug-in, `event` null or an event with its size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_poll(
    plugin: *const Plugin,
    patience: f64,
    event: *mut RawEvent,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (plugin, mut filled) = unsafe {
            (
                input::object("the plug-in", plugin)?,
                input::structure(event)?,
            )
        };
        if filled.size != size_of::<RawEvent>() {
            return Err(Trouble::Invalid(format!(
                "swarmwright_event: its size is {}, expected {}",
                filled.size,
                size_of::<RawEvent>()
            )));
        }
        plugin.poll(patience, &mut filled)?;
        // SAFETY: as the caller promises.
        unsafe { input::write("the event", event, filled) }
    })
}

/// Answers a reset or a step: these agents act next, and this is what they sense.
///
/// # Safety
/// `plugin` as above; `agents` are `count` numbers, `sensors` as many rows.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_sense(
    plugin: *const Plugin,
    agents: *const u32,
    count: usize,
    sensors: *const f32,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (plugin, agents, sensors) = unsafe {
            let plugin = input::object("the plug-in", plugin)?;
            let numbers = count.saturating_mul(plugin.description.sensors);
            (
                plugin,
                input::items("the agents", agents, count)?,
                input::items("the sensors", sensors, numbers)?,
            )
        };
        plugin.sense(agents, sensors)
    })
}

/// Answers a reset or a step: the episode has ended.
///
/// # Safety
/// `plugin` as above; `metrics` is null or as many numbers as the description has metrics.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_finish(
    plugin: *const Plugin,
    fitness: f64,
    metrics: *const f64,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (plugin, metrics) = unsafe {
            let plugin = input::object("the plug-in", plugin)?;
            let count = plugin.description.metrics.len();
            (plugin, input::items("the metrics", metrics, count)?)
        };
        plugin.relay.answer(Answer::Ended {
            fitness,
            metrics: metrics.to_vec(),
        })
    })
}

/// Answers a reset: a parameter cannot be used.
///
/// # Safety
/// `plugin` as above; the texts are null or end with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_refuse(
    plugin: *const Plugin,
    parameter: *const c_char,
    reason: *const c_char,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (plugin, name, reason) = unsafe {
            (
                input::object("the plug-in", plugin)?,
                input::lossy(parameter),
                input::lossy(reason),
            )
        };
        plugin
            .relay
            .answer(Answer::Refused(ParameterError { name, reason }))
    })
}

/// Answers a reset or a step: the episode cannot go on.
///
/// # Safety
/// `plugin` as above; the text is null or ends with NUL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_fail(
    plugin: *const Plugin,
    reason: *const c_char,
) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let (plugin, reason) =
            unsafe { (input::object("the plug-in", plugin)?, input::lossy(reason)) };
        plugin.relay.answer(Answer::Failed(reason))
    })
}

/// Gives up what is under way, leaves the broker and frees the plug-in; null is nothing to do.
///
/// # Safety
/// `plugin` is null or an open plug-in, which no other thread uses any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_plugin_close(plugin: *mut Plugin) -> i32 {
    shield(|| {
        if is_inside() {
            return Err(Trouble::invalid(
                "a function that is told of notices cannot close the plug-in",
            ));
        }
        if !plugin.is_null() {
            // SAFETY: it was made by `swarmwright_plugin_open`, and it is not used any more.
            drop(unsafe { Box::from_raw(plugin) });
        }
        Ok(())
    })
}
