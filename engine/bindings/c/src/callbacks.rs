//! The functions that the caller passes in.

use std::ffi::c_void;
use std::ptr::{null, null_mut};
use std::slice;
use std::sync::Arc;

use swarmwright_worlds::{Description, Scene};

use crate::error::{OK, Trouble, forget, from_callback};
use crate::input::{self, Structure};
use crate::live::{Live, inside};
use crate::parameters::ParameterHandle;
use crate::scene::Picture;

pub(crate) type Create =
    unsafe extern "C" fn(context: *mut c_void, simulation: *mut *mut c_void) -> i32;
pub(crate) type Destroy = unsafe extern "C" fn(simulation: *mut c_void);
type Reset =
    unsafe extern "C" fn(*mut c_void, parameters: *const ParameterHandle<'_>, seed: u64) -> i32;
type Acting = unsafe extern "C" fn(*mut c_void, agents: *mut *const u32, count: *mut usize) -> i32;
type IsDone = unsafe extern "C" fn(*mut c_void, done: *mut bool) -> i32;
type Sense = unsafe extern "C" fn(*mut c_void, agent: u32, sensors: *mut f32) -> i32;
type Step = unsafe extern "C" fn(*mut c_void, actuators: *const f32, count: usize) -> i32;
type Fitness = unsafe extern "C" fn(*mut c_void, fitness: *mut f64) -> i32;
type Metrics = unsafe extern "C" fn(*mut c_void, metrics: *mut f64) -> i32;
type Show = unsafe extern "C" fn(*mut c_void, milliseconds: *mut u32) -> i32;
type Draw = unsafe extern "C" fn(*mut c_void, scene: *mut Picture, milliseconds: *mut u32) -> i32;

/// `swarmwright_simulation`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawSimulation {
    size: usize,
    context: *mut c_void,
    only_one: u32,
    create: Option<Create>,
    destroy: Option<Destroy>,
    reset: Option<Reset>,
    acting: Option<Acting>,
    done: Option<IsDone>,
    sense: Option<Sense>,
    step: Option<Step>,
    fitness: Option<Fitness>,
    metrics: Option<Metrics>,
    show: Option<Show>,
    scene: Option<Draw>,
}

// SAFETY: as `Structure` asks.
unsafe impl Structure for RawSimulation {
    const NAME: &'static str = "swarmwright_simulation";
}

/// How objects of the caller's are made and ended.
#[derive(Clone)]
pub(crate) struct Maker {
    pub context: *mut c_void,
    pub create: Create,
    pub destroy: Option<Destroy>,
    pub live: Arc<Live>,
}

/// The functions of a simulation; the required ones are present.
pub(crate) struct Table {
    pub only_one: bool,
    maker: Maker,
    reset: Reset,
    acting: Acting,
    done: Option<IsDone>,
    sense: Sense,
    step: Step,
    fitness: Fitness,
    metrics: Option<Metrics>,
    show: Option<Show>,
    scene: Option<Draw>,
    pub description: Description,
}

// SAFETY: the header says that the functions are called from several threads, and `create` from one at a time.
unsafe impl Send for Table {}
// SAFETY: as above; nothing in it changes.
unsafe impl Sync for Table {}

/// Reads a table.
///
/// # Errors
/// A function that must be there is not.
///
/// # Safety
/// `pointer` is null or points to a table as the header describes it, whose functions keep to the header.
pub(crate) unsafe fn read(
    pointer: *const RawSimulation,
    description: Description,
) -> Result<Arc<Table>, Trouble> {
    // SAFETY: as the caller promises.
    let raw = unsafe { input::structure(pointer)? };
    let missing = |name: &str| {
        Trouble::Invalid(format!(
            "swarmwright_simulation.{name}: must not be a null pointer"
        ))
    };
    if !description.metrics.is_empty() && raw.metrics.is_none() {
        return Err(missing("metrics"));
    }
    Ok(Arc::new(Table {
        only_one: raw.only_one != 0,
        maker: Maker {
            context: raw.context,
            create: raw.create.ok_or_else(|| missing("create"))?,
            destroy: raw.destroy,
            live: Arc::default(),
        },
        reset: raw.reset.ok_or_else(|| missing("reset"))?,
        acting: raw.acting.ok_or_else(|| missing("acting"))?,
        done: raw.done,
        sense: raw.sense.ok_or_else(|| missing("sense"))?,
        step: raw.step.ok_or_else(|| missing("step"))?,
        fitness: raw.fitness.ok_or_else(|| missing("fitness"))?,
        metrics: raw.metrics,
        show: raw.show,
        scene: raw.scene,
        description,
    }))
}

impl Table {
    /// Counts the objects that are there.
    pub(crate) fn live(&self) -> Arc<Live> {
        Arc::clone(&self.maker.live)
    }
}

/// An object of the caller's, which is ended when this is dropped.
pub(crate) struct ForeignObject {
    pub pointer: *mut c_void,
    maker: Maker,
}

impl Maker {
    /// Makes an object.
    ///
    /// # Errors
    /// The caller's function reported an error.
    pub(crate) fn make(&self) -> Result<ForeignObject, Trouble> {
        let mut pointer = null_mut();
        // SAFETY: the functions keep to the header, and none of them unwinds.
        called("create", || unsafe {
            (self.create)(self.context, &raw mut pointer)
        })?;
        self.live.add();
        Ok(ForeignObject {
            pointer,
            maker: self.clone(),
        })
    }
}

impl Drop for ForeignObject {
    fn drop(&mut self) {
        if let Some(destroy) = self.maker.destroy {
            // SAFETY: `create` made the object, and no other reference to it is left.
            inside(|| unsafe { destroy(self.pointer) });
        }
        self.maker.live.remove();
    }
}

/// One of the caller's simulations.
pub(crate) struct Object {
    table: Arc<Table>,
    object: ForeignObject,
}

// SAFETY: the header says that an object is called from several threads, from one at a time.
unsafe impl Send for Object {}

/// Calls a function of the caller's.
///
/// # Errors
/// What it says is wrong.
pub(crate) fn called(name: &str, call: impl FnOnce() -> i32) -> Result<(), Trouble> {
    forget();
    match inside(call) {
        OK => Ok(()),
        status => Err(from_callback(status, name)),
    }
}

// Every `unsafe` below: the table's functions keep to the header, and none of them unwinds; the object is the one that
// `create` made, and what is pointed to is there and as long as the header says.
impl Object {
    pub(crate) fn create(table: &Arc<Table>) -> Result<Self, Trouble> {
        Ok(Self {
            object: table.maker.make()?,
            table: Arc::clone(table),
        })
    }

    pub(crate) fn table(&self) -> &Arc<Table> {
        &self.table
    }

    pub(crate) fn reset(&mut self, handle: &ParameterHandle<'_>, seed: u64) -> Result<(), Trouble> {
        // SAFETY: see above.
        called("reset", || unsafe {
            (self.table.reset)(self.object.pointer, handle, seed)
        })
    }

    /// Writes the agents that act.
    pub(crate) fn acting(&mut self, agents: &mut Vec<u32>) -> Result<(), Trouble> {
        let (mut first, mut count) = (null(), 0);
        // SAFETY: see above.
        called("acting", || unsafe {
            (self.table.acting)(self.object.pointer, &raw mut first, &raw mut count)
        })?;
        agents.clear();
        if count > 0 {
            if first.is_null() {
                return Err(Trouble::Failed(format!(
                    "the simulation's function acting returned {count} agents at a null pointer"
                )));
            }
            // SAFETY: they stay until the next call of this object.
            agents.extend_from_slice(unsafe { slice::from_raw_parts(first, count) });
        }
        Ok(())
    }

    /// Whether the episode has ended; none if that is when no agent acts.
    pub(crate) fn done(&mut self) -> Result<Option<bool>, Trouble> {
        let Some(call) = self.table.done else {
            return Ok(None);
        };
        let mut done = false;
        // SAFETY: see above.
        called("done", || unsafe {
            call(self.object.pointer, &raw mut done)
        })?;
        Ok(Some(done))
    }

    pub(crate) fn sense(&self, agent: u32, sensors: &mut [f32]) -> Result<(), Trouble> {
        // SAFETY: see above.
        called("sense", || unsafe {
            (self.table.sense)(self.object.pointer, agent, sensors.as_mut_ptr())
        })
    }

    pub(crate) fn step(&mut self, actuators: &[f32]) -> Result<(), Trouble> {
        // SAFETY: see above.
        called("step", || unsafe {
            (self.table.step)(self.object.pointer, actuators.as_ptr(), actuators.len())
        })
    }

    pub(crate) fn fitness(&self) -> Result<f64, Trouble> {
        let mut fitness = f64::NAN;
        // SAFETY: see above.
        called("fitness", || unsafe {
            (self.table.fitness)(self.object.pointer, &raw mut fitness)
        })?;
        Ok(fitness)
    }

    pub(crate) fn metrics(&self) -> Result<Vec<f64>, Trouble> {
        let mut metrics = vec![f64::NAN; self.table.description.metrics.len()];
        if let (Some(call), false) = (self.table.metrics, metrics.is_empty()) {
            // SAFETY: see above.
            called("metrics", || unsafe {
                call(self.object.pointer, metrics.as_mut_ptr())
            })?;
        }
        Ok(metrics)
    }

    /// Whether it says what it looks like.
    pub(crate) fn has_scenes(&self) -> bool {
        self.table.scene.is_some()
    }

    /// What it looks like, and for how many milliseconds; none without an extent.
    pub(crate) fn scene(&self) -> Result<Option<(Scene, u32)>, Trouble> {
        let Some(call) = self.table.scene else {
            return Ok(None);
        };
        let (mut picture, mut milliseconds) = (Picture(Scene::default()), 250);
        // SAFETY: see above.
        called("scene", || unsafe {
            call(self.object.pointer, &raw mut picture, &raw mut milliseconds)
        })?;
        Ok((picture.0.width > 0.0).then_some((picture.0, milliseconds)))
    }

    /// Lets the simulation show itself; returns for how many milliseconds to show it, `None` if there is nothing to see.
    pub(crate) fn show(&self) -> Result<Option<u32>, Trouble> {
        let Some(call) = self.table.show else {
            return Ok(None);
        };
        let mut milliseconds = 250;
        // SAFETY: see above.
        called("show", || unsafe {
            call(self.object.pointer, &raw mut milliseconds)
        })?;
        Ok(Some(milliseconds))
    }
}
