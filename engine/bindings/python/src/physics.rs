//! Simulators in Python that move the robots of missions, through `swarmwright.simulations.physics.PhysicsHost`.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};
use swarmwright_arena::{
    Motion, Physics, Pose, RobotModel, Settings, Start, World, WorldLight, WorldObject,
};
use swarmwright_kernels::{PhysicsKind, PhysicsSimulation};
use swarmwright_worlds::{ParameterError, Simulation};
use swarmwright_wrapper::Progress;

use crate::errors::input;
use crate::simulation::{Trouble, call, determinism, or_fail, refused};
use crate::values::{self, to_python};

/// The directions of proximity rays, by model of robot, radians counter-clockwise from ahead.
#[pyfunction]
pub fn rays(parameters: &Bound<'_, PyDict>) -> PyResult<Vec<Vec<f32>>> {
    let settings = Settings::read(&values::object("parameters", parameters)?).map_err(input)?;
    let models = World::new(&settings).models;
    Ok(models.into_iter().map(|model| model.rays).collect())
}

/// Whether a host is one of these.
pub fn moves_robots(host: &Bound<'_, PyAny>) -> PyResult<bool> {
    host.getattr("moves_robots")?.extract()
}

/// The simulation of missions in a host's simulator, which gives a sign of life with each call of its code.
pub fn simulation(
    host: &Bound<'_, PyAny>,
    progress: Option<Arc<Progress>>,
) -> PyResult<Box<dyn Simulation>> {
    // The host's own object comes first: there may be no other.
    let first = Mutex::new(Some(host.clone().unbind()));
    let another = host.clone().unbind();
    let copies: bool = host.getattr("copies")?.extract()?;
    let kind = PhysicsKind {
        title: host.getattr("title")?.extract()?,
        determinism: determinism(host)?,
        only_one: !copies,
        create: Box::new(move || {
            let first = first.lock().unwrap_or_else(PoisonError::into_inner).take();
            let host = first.map_or_else(
                || {
                    call(&another, progress.as_deref(), |host| {
                        Ok(host.call_method0("another")?.unbind())
                    })
                },
                Ok,
            );
            match host {
                Ok(host) => Ok(Box::new(Foreign {
                    host,
                    rays: Vec::new(),
                    progress: progress.clone(),
                })),
                Err(Trouble::Refused(reason)) => Err(reason),
                Err(Trouble::Failed(failure)) => Err(failure.reason),
            }
        }),
    };
    let simulation = PhysicsSimulation::new(Arc::new(kind)).map_err(input)?;
    Ok(Box::new(simulation))
}

/// A simulator of the user's.
struct Foreign {
    host: Py<PyAny>,
    /// By robot: what its rays measure now; empty where they are to be computed.
    rays: Vec<Vec<f32>>,
    progress: Option<Arc<Progress>>,
}

impl Foreign {
    fn call<T>(&self, action: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>) -> Result<T, Trouble> {
        call(&self.host, self.progress.as_deref(), action)
    }
}

fn model(model: &RobotModel) -> Value {
    json!({
        "radius": model.radius, "height": model.height, "mass": model.mass,
        "wheel_base": model.wheel_base, "top_speed": model.top_speed,
        "acceleration": model.acceleration, "rays": model.rays,
        "ray_start": model.ray_start, "ray_range": model.ray_range,
    })
}

fn light(light: &WorldLight) -> Value {
    json!({"x": light.x, "y": light.y, "z": light.z, "intensity": light.intensity})
}

fn object(object: &WorldObject) -> Value {
    json!({
        "radius": object.radius, "width": object.size[0], "depth": object.size[1],
        "height": object.height, "mass": object.mass, "friction": object.friction,
    })
}

/// The fields of `swarmwright.simulations.physics.World`.
fn fields(world: &World) -> Value {
    let walls = world.walls.iter();
    let walls: Vec<_> = walls
        .map(|wall| json!({"points": wall.points, "height": wall.height}))
        .collect();
    let patches = world.patches.iter();
    let patches: Vec<_> = patches
        .map(|patch| json!({"points": patch.points, "grey": patch.grey}))
        .collect();
    json!({
        "tick": world.tick, "grey": world.grey, "walls": walls, "patches": patches,
        "lights": world.lights.iter().map(light).collect::<Vec<_>>(),
        "models": world.models.iter().map(model).collect::<Vec<_>>(),
        "robots": world.robots,
        "objects": world.objects.iter().map(object).collect::<Vec<_>>(),
    })
}

/// Rows of three numbers for Python.
fn rows<'py>(
    py: Python<'py>,
    rows: impl ExactSizeIterator<Item = [f32; 3]>,
) -> PyResult<Bound<'py, PyAny>> {
    let count = rows.len();
    let numbers: Vec<f32> = rows.flatten().collect();
    Ok(PyArray1::from_vec(py, numbers)
        .reshape([count, 3])?
        .into_any())
}

fn numbers(pose: &Pose) -> [f32; 3] {
    [pose.x, pose.y, pose.heading]
}

fn fill(poses: &mut [Pose], rows: &PyReadonlyArray2<'_, f32>) {
    for (pose, row) in poses.iter_mut().zip(rows.as_array().rows()) {
        *pose = Pose {
            x: row[0],
            y: row[1],
            heading: row[2],
        };
    }
}

impl Physics for Foreign {
    fn start(&mut self, start: &Start<'_>) -> Result<(), ParameterError> {
        let begun = self.call(|host| {
            let py = host.py();
            let world = to_python(py, &fields(start.world))?;
            let robots = rows(py, start.robots.iter().map(numbers))?;
            let objects = rows(py, start.objects.iter().map(numbers))?;
            host.call_method1("start", (world, start.changed, robots, objects, start.seed))?;
            Ok(())
        });
        match begun {
            Err(Trouble::Refused(text)) => Err(refused(&text)),
            other => {
                or_fail(other);
                Ok(())
            }
        }
    }

    fn step(&mut self, robots: &[Motion]) {
        or_fail(self.call(|host| {
            let motions = robots.iter().map(|m| [m.forward, m.sideways, m.turn]);
            host.call_method1("step", (rows(host.py(), motions)?,))?;
            Ok(())
        }));
    }

    fn poses(&mut self, robots: &mut [Pose], objects: &mut [Pose]) {
        let rays = or_fail(self.call(|host| {
            let returned = host.call_method0("poses")?;
            let (first, second): (PyReadonlyArray2<'_, f32>, PyReadonlyArray2<'_, f32>) =
                returned.extract()?;
            fill(robots, &first);
            fill(objects, &second);
            let rays = host.call_method0("rays")?;
            if rays.is_none() {
                return Ok(Vec::new());
            }
            let rays: PyReadonlyArray2<'_, f32> = rays.extract()?;
            Ok(rays
                .as_array()
                .rows()
                .into_iter()
                .map(|row| row.to_vec())
                .collect())
        }));
        self.rays = rays;
    }

    fn rays(&mut self, robot: usize, distances: &mut [f32]) -> bool {
        let Some(rays) = self.rays.get(robot) else {
            return false;
        };
        distances.copy_from_slice(&rays[..distances.len()]);
        true
    }
}
