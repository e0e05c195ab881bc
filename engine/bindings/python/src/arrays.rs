//! What a scene has many of, as arrays.

use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_worlds::{Body, Ray};

/// Bodies: kinds and states that there are, and for each body which of them it has, and its numbers. NaN stands for no
/// heading and no value, -1 for no agent; labels are none where no body has one.
pub fn bodies<'py>(py: Python<'py>, bodies: &[Body]) -> PyResult<Bound<'py, PyDict>> {
    let mut looks: Vec<(&str, &str)> = Vec::new();
    let mut look = Vec::with_capacity(bodies.len());
    for body in bodies {
        let pair = (&*body.kind, &*body.state);
        let last = look.last().map(|index: &u16| usize::from(*index));
        let same = last.filter(|index| looks[*index] == pair);
        let index = same.or_else(|| looks.iter().position(|other| *other == pair));
        look.push(index.unwrap_or_else(|| {
            looks.push(pair);
            looks.len() - 1
        }) as u16);
    }
    let numbers = |of: fn(&Body) -> f32| bodies.iter().map(of).collect::<Vec<_>>();
    let fields = PyDict::new(py);
    fields.set_item("looks", looks)?;
    fields.set_item("look", look.into_pyarray(py))?;
    fields.set_item("x", numbers(|body| body.x).into_pyarray(py))?;
    fields.set_item("y", numbers(|body| body.y).into_pyarray(py))?;
    fields.set_item("radius", numbers(|body| body.radius).into_pyarray(py))?;
    fields.set_item(
        "heading",
        numbers(|body| body.heading.unwrap_or(f32::NAN)).into_pyarray(py),
    )?;
    fields.set_item(
        "value",
        numbers(|body| body.value.unwrap_or(f32::NAN)).into_pyarray(py),
    )?;
    let agents = bodies.iter().map(|body| body.agent.map_or(-1, i64::from));
    fields.set_item("agent", agents.collect::<Vec<_>>().into_pyarray(py))?;
    let labelled = bodies.iter().any(|body| !body.label.is_empty());
    let labels: Option<Vec<&str>> =
        labelled.then(|| bodies.iter().map(|body| &*body.label).collect());
    fields.set_item("labels", labels)?;
    Ok(fields)
}

/// Rays: indices of bodies, and (rays, 4): angle, start, length, reading or NaN.
pub fn rays<'py>(py: Python<'py>, rays: &[Ray]) -> PyResult<Bound<'py, PyDict>> {
    let body: Vec<u32> = rays.iter().map(|ray| ray.body).collect();
    let numbers: Vec<f32> = rays
        .iter()
        .flat_map(|ray| {
            let reading = ray.reading.unwrap_or(f32::NAN);
            [ray.angle, ray.start, ray.length, reading]
        })
        .collect();
    let fields = PyDict::new(py);
    fields.set_item("body", body.into_pyarray(py))?;
    fields.set_item(
        "numbers",
        numbers.into_pyarray(py).reshape([rays.len(), 4])?,
    )?;
    Ok(fields)
}

/// Links: (links, 2), indices of bodies.
pub fn links<'py>(py: Python<'py>, links: &[[u32; 2]]) -> PyResult<Bound<'py, PyAny>> {
    let flat: Vec<u32> = links.iter().flatten().copied().collect();
    Ok(flat.into_pyarray(py).reshape([links.len(), 2])?.into_any())
}
