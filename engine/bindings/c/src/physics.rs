//! A simulator of the caller's that moves the robots of missions.

use std::ffi::{c_char, c_void};
use std::sync::Arc;

use swarmwright_arena::{Motion, Physics, Pose, RobotModel, Start, World, WorldLight, WorldObject};
use swarmwright_kernels::PhysicsKind;
use swarmwright_worlds::{ParameterError, fail};

use crate::callbacks::{Create, Destroy, ForeignObject, Maker, called};
use crate::description::{check_title, determinism};
use crate::error::Trouble;
use crate::input::{self, Structure};
use crate::live::Live;

/// What names of missions in other simulators begin with.
const TITLES: &str = "arena-";

type Begin = unsafe extern "C" fn(*mut c_void, start: *const RawStart) -> i32;
type Move = unsafe extern "C" fn(*mut c_void, robots: *const Motion, count: usize) -> i32;
type Poses = unsafe extern "C" fn(*mut c_void, robots: *mut Pose, objects: *mut Pose) -> i32;
type Rays = unsafe extern "C" fn(*mut c_void, robot: u32, distances: *mut f32, count: usize) -> i32;

/// `swarmwright_polygon`.
#[repr(C)]
struct RawPolygon {
    points: *const f32,
    count: usize,
    height: f32,
    grey: f32,
}

/// `swarmwright_robot`.
#[repr(C)]
struct RawRobot {
    radius: f32,
    height: f32,
    mass: f32,
    wheel_base: f32,
    top_speed: f32,
    acceleration: f32,
    ray_start: f32,
    ray_range: f32,
    rays: *const f32,
    ray_count: usize,
}

/// `swarmwright_object`.
#[repr(C)]
struct RawObject {
    radius: f32,
    width: f32,
    depth: f32,
    height: f32,
    mass: f32,
    friction: f32,
}

/// `swarmwright_world`.
#[repr(C)]
struct RawWorld {
    size: usize,
    tick: f32,
    grey: f32,
    walls: *const RawPolygon,
    wall_count: usize,
    patches: *const RawPolygon,
    patch_count: usize,
    lights: *const WorldLight,
    light_count: usize,
    models: *const RawRobot,
    model_count: usize,
    robots: *const u32,
    robot_count: usize,
    objects: *const RawObject,
    object_count: usize,
}

/// `swarmwright_start`.
#[repr(C)]
struct RawStart {
    size: usize,
    world: *const RawWorld,
    changed: bool,
    robots: *const Pose,
    objects: *const Pose,
    seed: u64,
}

/// `swarmwright_physics`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawPhysics {
    size: usize,
    title: *const c_char,
    determinism: i32,
    tolerance: f64,
    context: *mut c_void,
    only_one: u32,
    create: Option<Create>,
    destroy: Option<Destroy>,
    start: Option<Begin>,
    step: Option<Move>,
    poses: Option<Poses>,
    rays: Option<Rays>,
}

// SAFETY: as `Structure` asks.
unsafe impl Structure for RawPhysics {
    const NAME: &'static str = "swarmwright_physics";
}

/// The functions of a simulator.
#[derive(Clone)]
struct Table {
    maker: Maker,
    start: Begin,
    step: Move,
    poses: Poses,
    rays: Option<Rays>,
}

// SAFETY: the header says that the functions are called from several threads, and `create` from one at a time.
unsafe impl Send for Table {}
// SAFETY: as above; nothing in it changes.
unsafe impl Sync for Table {}

/// Reads a table; also what counts its objects.
///
/// # Errors
/// A function that must be there is not, no title.
///
/// # Safety
/// `pointer` is null or points to a table as the header describes it, whose functions keep to the header.
pub(crate) unsafe fn read(pointer: *const RawPhysics) -> Result<(PhysicsKind, Arc<Live>), Trouble> {
    // SAFETY: as the caller promises.
    let (raw, title) = unsafe {
        let raw = input::structure(pointer)?;
        (raw, input::text("swarmwright_physics.title", raw.title)?)
    };
    check_title(title)?;
    if !title.starts_with(TITLES) {
        return Err(Trouble::Invalid(format!(
            "swarmwright_physics.title: {title:?} found, expected {TITLES}NAME, the name of the simulation in experiments"
        )));
    }
    let missing = |name: &str| {
        Trouble::Invalid(format!(
            "swarmwright_physics.{name}: must not be a null pointer"
        ))
    };
    let live = Arc::<Live>::default();
    let table = Table {
        maker: Maker {
            context: raw.context,
            create: raw.create.ok_or_else(|| missing("create"))?,
            destroy: raw.destroy,
            live: Arc::clone(&live),
        },
        start: raw.start.ok_or_else(|| missing("start"))?,
        step: raw.step.ok_or_else(|| missing("step"))?,
        poses: raw.poses.ok_or_else(|| missing("poses"))?,
        rays: raw.rays,
    };
    let kind = PhysicsKind {
        title: title.to_owned(),
        determinism: determinism(title, raw.determinism, raw.tolerance)?,
        only_one: raw.only_one != 0,
        create: Box::new(move || Foreign::boxed(&table)),
    };
    Ok((kind, live))
}

/// One of the caller's simulators.
struct Foreign {
    table: Table,
    object: ForeignObject,
}

// SAFETY: the header says that an object is called from several threads, from one at a time.
unsafe impl Send for Foreign {}

fn message_of(trouble: Trouble) -> String {
    match trouble {
        Trouble::Invalid(text) | Trouble::Failed(text) => text,
        Trouble::Parameter(error) => error.to_string(),
    }
}

impl Foreign {
    fn boxed(table: &Table) -> Result<Box<dyn Physics>, String> {
        let object = table.maker.make().map_err(message_of)?;
        Ok(Box::new(Self {
            object,
            table: table.clone(),
        }))
    }
}

fn polygon(points: &[[f32; 2]], height: f32, grey: f32) -> RawPolygon {
    RawPolygon {
        points: points.as_ptr().cast(),
        count: points.len(),
        height,
        grey,
    }
}

fn robot(model: &RobotModel) -> RawRobot {
    RawRobot {
        radius: model.radius,
        height: model.height,
        mass: model.mass,
        wheel_base: model.wheel_base,
        top_speed: model.top_speed,
        acceleration: model.acceleration,
        ray_start: model.ray_start,
        ray_range: model.ray_range,
        rays: model.rays.as_ptr(),
        ray_count: model.rays.len(),
    }
}

fn object(object: &WorldObject) -> RawObject {
    RawObject {
        radius: object.radius,
        width: object.size[0],
        depth: object.size[1],
        height: object.height,
        mass: object.mass,
        friction: object.friction,
    }
}

/// Makes a world as C reads it, for the time of a call.
fn with_world<T>(world: &World, call: impl FnOnce(&RawWorld) -> T) -> T {
    let walls = world.walls.iter();
    let walls: Vec<_> = walls
        .map(|wall| polygon(&wall.points, wall.height, 0.0))
        .collect();
    let patches = world.patches.iter();
    let patches: Vec<_> = patches
        .map(|patch| polygon(&patch.points, 0.0, patch.grey))
        .collect();
    let models: Vec<_> = world.models.iter().map(robot).collect();
    let objects: Vec<_> = world.objects.iter().map(object).collect();
    call(&RawWorld {
        size: size_of::<RawWorld>(),
        tick: world.tick,
        grey: world.grey,
        walls: walls.as_ptr(),
        wall_count: walls.len(),
        patches: patches.as_ptr(),
        patch_count: patches.len(),
        lights: world.lights.as_ptr(),
        light_count: world.lights.len(),
        models: models.as_ptr(),
        model_count: models.len(),
        robots: world.robots.as_ptr(),
        robot_count: world.robots.len(),
        objects: objects.as_ptr(),
        object_count: objects.len(),
    })
}

fn or_fail(result: Result<(), Trouble>) {
    if let Err(trouble) = result {
        fail(message_of(trouble));
    }
}

// Every `unsafe` below: the table's functions keep to the header, and none of them unwinds; the object is the one that
// `create` made, and what is pointed to is there and as long as the header says.
impl Physics for Foreign {
    fn start(&mut self, start: &Start<'_>) -> Result<(), ParameterError> {
        let begun = with_world(start.world, |world| {
            let raw = RawStart {
                size: size_of::<RawStart>(),
                world,
                changed: start.changed,
                robots: start.robots.as_ptr(),
                objects: start.objects.as_ptr(),
                seed: start.seed,
            };
            // SAFETY: see above.
            called("start", || unsafe {
                (self.table.start)(self.object.pointer, &raw const raw)
            })
        });
        match begun {
            Err(Trouble::Parameter(error)) => Err(error),
            other => {
                or_fail(other);
                Ok(())
            }
        }
    }

    fn step(&mut self, robots: &[Motion]) {
        // SAFETY: see above.
        or_fail(called("step", || unsafe {
            (self.table.step)(self.object.pointer, robots.as_ptr(), robots.len())
        }));
    }

    fn poses(&mut self, robots: &mut [Pose], objects: &mut [Pose]) {
        let (robots, objects) = (robots.as_mut_ptr(), objects.as_mut_ptr());
        // SAFETY: see above.
        or_fail(called("poses", || unsafe {
            (self.table.poses)(self.object.pointer, robots, objects)
        }));
    }

    fn rays(&mut self, robot: usize, distances: &mut [f32]) -> bool {
        let Some(rays) = self.table.rays else {
            return false;
        };
        let (pointer, count) = (distances.as_mut_ptr(), distances.len());
        // SAFETY: see above.
        or_fail(called("rays", || unsafe {
            rays(self.object.pointer, robot as u32, pointer, count)
        }));
        true
    }
}
