//! What an episode looks like, filled by the caller's functions.

use std::ffi::c_char;

use swarmwright_worlds::{Body, Light, Patch, Ray, Scale, Scene, Style, Wall};

use crate::error::{Trouble, shield};
use crate::input::{self, Structure};

/// `swarmwright_body`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawBody {
    size: usize,
    kind: *const c_char,
    state: *const c_char,
    x: f32,
    y: f32,
    radius: f32,
    heading: f32,
    value: f32,
    agent: i64,
    label: *const c_char,
}

// SAFETY: as `Structure` asks.
unsafe impl Structure for RawBody {
    const NAME: &'static str = "swarmwright_body";
}

/// `swarmwright_scene`.
pub struct Picture(pub(crate) Scene);

/// Fills a scene; what is wrong is said to the caller.
///
/// # Safety
/// `scene` is null or the one that the caller was given, within that call.
unsafe fn fill(scene: *mut Picture, work: impl FnOnce(&mut Scene) -> Result<(), Trouble>) -> i32 {
    shield(|| {
        // SAFETY: as the caller promises.
        let picture = unsafe { scene.as_mut() }
            .ok_or_else(|| Trouble::invalid("the scene: must not be a null pointer"))?;
        work(&mut picture.0)
    })
}

fn finite(label: &str, numbers: &[f32]) -> Result<(), Trouble> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(Trouble::invalid(format!(
            "{label}: {number} found, expected finite numbers"
        ))),
        None => Ok(()),
    }
}

/// Points behind a pointer, two numbers each.
///
/// # Safety
/// As `input::items`.
unsafe fn points(pointer: *const f32, count: usize) -> Result<Vec<[f32; 2]>, Trouble> {
    // SAFETY: as the caller promises.
    let numbers = unsafe { input::items("the points", pointer, 2 * count)? };
    finite("the points", numbers)?;
    Ok(numbers.as_chunks::<2>().0.to_vec())
}

/// Checks an index of a body.
fn body(scene: &Scene, index: u32) -> Result<(), Trouble> {
    if (index as usize) < scene.bodies.len() {
        return Ok(());
    }
    Err(Trouble::invalid(format!(
        "body {index} does not exist; the scene has {} bodies so far",
        scene.bodies.len()
    )))
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_world(
    scene: *mut Picture,
    width: f32,
    height: f32,
    grid: bool,
    message: *const c_char,
) -> i32 {
    let work = |scene: &mut Scene| {
        if !(width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite()) {
            return Err(Trouble::invalid(format!(
                "the extent of a scene: {width} x {height} found, expected numbers above 0"
            )));
        }
        // SAFETY: as the header says.
        let message = unsafe { input::optional("the message", message)? };
        (scene.width, scene.height, scene.grid) = (width, height, grid);
        scene.message = message.unwrap_or_default().to_owned();
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_origin(scene: *mut Picture, x: f32, y: f32) -> i32 {
    let work = |scene: &mut Scene| {
        finite("the origin", &[x, y])?;
        scene.origin = [x, y];
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_body(
    scene: *mut Picture,
    body: *const RawBody,
    index: *mut u32,
) -> i32 {
    let work = |scene: &mut Scene| {
        // SAFETY: as the header says.
        let raw = unsafe { input::structure(body)? };
        finite("a body", &[raw.x, raw.y, raw.radius])?;
        if raw.radius < 0.0 || raw.heading.is_infinite() || raw.value.is_infinite() {
            return Err(Trouble::invalid(
                "a body has a radius below 0, or an infinite heading or value",
            ));
        }
        // SAFETY: as the header says.
        let [kind, state, label] = unsafe {
            [
                Some(input::text("the kind of a body", raw.kind)?),
                input::optional("the state of a body", raw.state)?,
                input::optional("the label of a body", raw.label)?,
            ]
        }
        .map(|text| text.unwrap_or_default().to_owned().into());
        let number = |value: f32| Some(value).filter(|value| !value.is_nan());
        scene.bodies.push(Body {
            kind,
            state,
            label,
            x: raw.x,
            y: raw.y,
            radius: raw.radius,
            heading: number(raw.heading),
            value: number(raw.value),
            agent: u32::try_from(raw.agent).ok(),
        });
        if index.is_null() {
            return Ok(());
        }
        // SAFETY: as the header says.
        unsafe { input::write("the index", index, scene.bodies.len() as u32 - 1) }
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_ray(
    scene: *mut Picture,
    of: u32,
    angle: f32,
    start: f32,
    length: f32,
    reading: f32,
) -> i32 {
    let work = |scene: &mut Scene| {
        body(scene, of)?;
        finite("a ray", &[angle, start, length])?;
        scene.rays.push(Ray {
            body: of,
            angle,
            start,
            length,
            reading: Some(reading).filter(|reading| !reading.is_nan()),
        });
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_link(scene: *mut Picture, from: u32, to: u32) -> i32 {
    let work = |scene: &mut Scene| {
        body(scene, from)?;
        body(scene, to)?;
        scene.links.push([from, to]);
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_patch(
    scene: *mut Picture,
    grey: f32,
    radius: f32,
    corners: *const f32,
    count: usize,
    name: *const c_char,
) -> i32 {
    let work = |scene: &mut Scene| {
        finite("a patch", &[grey, radius])?;
        if !(0.0..=1.0).contains(&grey) || radius < 0.0 {
            return Err(Trouble::invalid(format!(
                "a patch: grey {grey} and radius {radius} found, expected grey from 0 to 1 and a radius of at least 0"
            )));
        }
        // SAFETY: as the header says.
        let (points, name) = unsafe {
            (
                points(corners, count)?,
                input::optional("the name of a patch", name)?,
            )
        };
        let is_floor = points.is_empty();
        let patch = Patch {
            points,
            radius,
            grey,
            name: name.unwrap_or_default().to_owned(),
        };
        if is_floor {
            scene.floor = Some(patch);
        } else {
            scene.patches.push(patch);
        }
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_wall(
    scene: *mut Picture,
    corners: *const f32,
    count: usize,
    solid: bool,
) -> i32 {
    let work = |scene: &mut Scene| {
        // SAFETY: as the header says.
        let points = unsafe { points(corners, count)? };
        scene.walls.push(Wall { points, solid });
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_light(
    scene: *mut Picture,
    x: f32,
    y: f32,
    intensity: f32,
) -> i32 {
    let work = |scene: &mut Scene| {
        finite("a light", &[x, y, intensity])?;
        scene.lights.push(Light { x, y, intensity });
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_style(
    scene: *mut Picture,
    kind: *const c_char,
    state: *const c_char,
    color: *const c_char,
    shape: *const c_char,
) -> i32 {
    let work = |scene: &mut Scene| {
        // SAFETY: as the header says.
        let [kind, state, color, shape] = unsafe {
            [
                Some(input::text("the kind of a style", kind)?),
                input::optional("the state of a style", state)?,
                input::optional("the color of a style", color)?,
                input::optional("the shape of a style", shape)?,
            ]
        }
        .map(|text| text.unwrap_or_default().to_owned());
        scene.styles.push(Style {
            kind,
            state,
            color,
            shape,
        });
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}

/// # Safety
/// As the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn swarmwright_scene_scale(
    scene: *mut Picture,
    name: *const c_char,
    low: f32,
    high: f32,
) -> i32 {
    let work = |scene: &mut Scene| {
        finite("a scale", &[low, high])?;
        // SAFETY: as the header says.
        let name = unsafe { input::text("the name of a scale", name)? }.to_owned();
        scene.scale = Some(Scale { name, low, high });
        Ok(())
    };
    // SAFETY: as the header says.
    unsafe { fill(scene, work) }
}
