//! New candidates of methods that keep members: differential evolution and particle swarms.

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use swarmwright_evolution::{self as evolution, Base, Crossover, Differential, Flight, Swarm};

use crate::errors::input;
use crate::streams::PyStreams;

#[pyfunction]
#[pyo3(signature = (members, best, streams, *, base, crossover, factor, rate, mutate, lower, upper))]
#[expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "pyo3 hands arguments over by value, one by one"
)]
pub fn trials<'py>(
    py: Python<'py>,
    members: PyReadonlyArray2<'py, f32>,
    best: usize,
    mut streams: PyRefMut<'py, PyStreams>,
    base: &str,
    crossover: &str,
    factor: f64,
    rate: f64,
    mutate: f64,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let [count, genes] = [members.shape()[0], members.shape()[1]];
    if count < 4 || best >= count || streams.0.len() != count {
        return Err(input(format!(
            "expected at least 4 members, the best of them and a stream for each; found {count}, {best} and {}",
            streams.0.len()
        )));
    }
    let settings = Differential {
        base: match base {
            "best" => Base::Best,
            "rand" => Base::Random,
            "target-to-best" => Base::TargetToBest,
            other => return Err(input(format!("base: unknown: {other}"))),
        },
        crossover: match crossover {
            "bin" => Crossover::Binomial,
            "exp" => Crossover::Exponential,
            "hypercube" => Crossover::Hypercube,
            "line" => Crossover::Line,
            other => return Err(input(format!("crossover: unknown: {other}"))),
        },
        factor,
        rate,
        mutate,
        lower: of_each(&lower, genes)?,
        upper: of_each(&upper, genes)?,
    };
    let members = members.as_slice()?;
    let mut genomes = vec![0.0; count * genes];
    let mut trial = vec![0.0; genes];
    for (target, stream) in streams.0.iter_mut().enumerate() {
        settings.trial(members, best, target, stream, &mut trial);
        let genome = &mut genomes[target * genes..(target + 1) * genes];
        rounded(&trial, settings.lower, settings.upper, genome);
    }
    PyArray1::from_vec(py, genomes).reshape([count, genes])
}

type PlacesAndVelocities<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f64>>);

#[pyfunction]
#[pyo3(signature = (places, velocities, own, social, streams, *, inertia, pulls, fastest, lower, upper, perturbed))]
#[expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "pyo3 hands arguments over by value, one by one"
)]
pub fn flights<'py>(
    py: Python<'py>,
    places: PyReadonlyArray2<'py, f32>,
    velocities: PyReadonlyArray2<'py, f64>,
    own: PyReadonlyArray2<'py, f32>,
    social: usize,
    mut streams: PyRefMut<'py, PyStreams>,
    inertia: f64,
    pulls: (f64, f64),
    fastest: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    perturbed: bool,
) -> PyResult<PlacesAndVelocities<'py>> {
    let [count, genes] = [places.shape()[0], places.shape()[1]];
    let shape = places.shape();
    if velocities.shape() != shape
        || own.shape() != shape
        || streams.0.len() != count
        || social >= count
    {
        return Err(input(
            "expected as many places, velocities, best places and streams, and the number of one of them",
        ));
    }
    let settings = Swarm {
        inertia,
        own: pulls.0,
        social: pulls.1,
        fastest: of_each(&fastest, genes)?,
        lower: of_each(&lower, genes)?,
        upper: of_each(&upper, genes)?,
    };
    let (places, own) = (places.as_slice()?, own.as_slice()?);
    let mut speeds = velocities.as_slice()?.to_vec();
    let mut genomes = vec![0.0; count * genes];
    let mut to = vec![0.0; genes];
    let best = &own[social * genes..(social + 1) * genes];
    for (particle, stream) in streams.0.iter_mut().enumerate() {
        let its = particle * genes..(particle + 1) * genes;
        let flight = Flight {
            from: &places[its.clone()],
            own: &own[its.clone()],
            social: best,
        };
        settings.fly(flight, stream, &mut speeds[its.clone()], &mut to);
        if perturbed && particle == social {
            settings.perturb(best, stream, &mut to);
        }
        rounded(&to, settings.lower, settings.upper, &mut genomes[its]);
    }
    Ok((
        PyArray1::from_vec(py, genomes).reshape([count, genes])?,
        PyArray1::from_vec(py, speeds).reshape([count, genes])?,
    ))
}

#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]
pub fn spread<'py>(
    places: PyReadonlyArray2<'py, f32>,
    best: usize,
    width: PyReadonlyArray1<'py, f64>,
) -> PyResult<f64> {
    let [count, genes] = [places.shape()[0], places.shape()[1]];
    if count < 2 || best >= count {
        return Err(input(format!(
            "expected at least two places, and the best of them; found {count} and {best}"
        )));
    }
    let (places, width) = (places.as_slice()?, of_each(&width, genes)?);
    Ok(evolution::spread(
        places,
        &places[best * genes..(best + 1) * genes],
        width,
    ))
}

/// A genome: within the bounds, rounded to binary32.
#[expect(clippy::cast_possible_truncation, reason = "genomes are binary32")]
fn rounded(values: &[f64], lower: &[f64], upper: &[f64], genome: &mut [f32]) {
    for (gene, place) in genome.iter_mut().enumerate() {
        *place = values[gene].clamp(lower[gene], upper[gene]) as f32;
    }
}

fn of_each<'a>(values: &'a PyReadonlyArray1<'_, f64>, genes: usize) -> PyResult<&'a [f64]> {
    if values.len() != genes {
        return Err(input(format!(
            "expected a value for each of {genes} genes, found {}",
            values.len()
        )));
    }
    Ok(values.as_slice()?)
}
