//! Genetic operators of networks, of one genome and of many.

use std::borrow::Cow;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use swarmwright_controllers::{MAX_WEIGHTS, NodeActivation};
use swarmwright_evolution::{
    self as evolution, Compatibility, Farthest, GrowingNetwork, Mutation, NodeNetwork,
    PatternFunction, Stream, WeightMutation,
};

use crate::errors::input;
use crate::streams::{PyStream, PyStreams};

/// The operators of networks whose genomes are rows of nodes.
#[pyclass(name = "NodeNetwork", module = "swarmwright._engine", frozen)]
pub struct PyNodeNetwork(pub NodeNetwork);

#[pymethods]
impl PyNodeNetwork {
    #[new]
    #[pyo3(signature = (sizes, *, weight_range, bias_range, mutation))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn new(
        sizes: Vec<usize>,
        weight_range: f64,
        bias_range: f64,
        mutation: &str,
    ) -> PyResult<Self> {
        let mutation = match mutation {
            "uniform" => Mutation::Uniform,
            "proportional" => Mutation::Proportional,
            other => {
                return Err(input(format!(
                    "mutation: {other:?} found, expected uniform or proportional"
                )));
            }
        };
        if sizes.is_empty() {
            return Err(input(
                "sizes: must not be empty, since a network has at least one node",
            ));
        }
        Ok(Self(NodeNetwork::new(
            &sizes,
            weight_range,
            bias_range,
            mutation,
        )))
    }

    fn initial<'py>(
        &self,
        py: Python<'py>,
        stream: &mut PyStream,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let streams = std::slice::from_mut(&mut stream.0);
        self.each(py, streams, |_, stream, genome| {
            self.0.initial(stream, genome);
        })?
        .reshape([self.0.genes()])
    }

    fn initials<'py>(
        &self,
        py: Python<'py>,
        streams: &mut PyStreams,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.each(py, &mut streams.0, |_, stream, genome| {
            self.0.initial(stream, genome);
        })
    }

    #[pyo3(signature = (parent, stream, *, severity, probability))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn mutate<'py>(
        &self,
        py: Python<'py>,
        parent: PyReadonlyArray1<'py, f32>,
        stream: &mut PyStream,
        severity: f64,
        probability: f64,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let parent = self.genome("genome", &parent)?;
        let streams = std::slice::from_mut(&mut stream.0);
        self.each(py, streams, |_, stream, child| {
            self.0.mutate(&parent, stream, severity, probability, child);
        })?
        .reshape([self.0.genes()])
    }

    #[pyo3(signature = (parents, streams, *, severity, probability))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn mutations<'py>(
        &self,
        py: Python<'py>,
        parents: PyReadonlyArray2<'py, f32>,
        streams: &mut PyStreams,
        severity: f64,
        probability: f64,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let parents = self.genomes("parents", &parents, streams.0.len())?;
        self.each(py, &mut streams.0, |index, stream, child| {
            let parent = self.row(&parents, index);
            self.0.mutate(parent, stream, severity, probability, child);
        })
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn crossover<'py>(
        &self,
        py: Python<'py>,
        mother: PyReadonlyArray1<'py, f32>,
        father: PyReadonlyArray1<'py, f32>,
        stream: &mut PyStream,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let mother = self.genome("mother", &mother)?;
        let father = self.genome("father", &father)?;
        let streams = std::slice::from_mut(&mut stream.0);
        self.each(py, streams, |_, stream, child| {
            self.0.crossover(&mother, &father, stream, child);
        })?
        .reshape([self.0.genes()])
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn crossovers<'py>(
        &self,
        py: Python<'py>,
        mothers: PyReadonlyArray2<'py, f32>,
        fathers: PyReadonlyArray2<'py, f32>,
        streams: &mut PyStreams,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let mothers = self.genomes("mothers", &mothers, streams.0.len())?;
        let fathers = self.genomes("fathers", &fathers, streams.0.len())?;
        self.each(py, &mut streams.0, |index, stream, child| {
            let (mother, father) = (self.row(&mothers, index), self.row(&fathers, index));
            self.0.crossover(mother, father, stream, child);
        })
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn matings<'py>(
        &self,
        py: Python<'py>,
        genomes: PyReadonlyArray2<'py, f32>,
        mothers: PyReadonlyArray1<'py, i64>,
        partners: PyReadonlyArray2<'py, i64>,
        streams: &mut PyStreams,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (count, columns) = (streams.0.len(), partners.shape()[1]);
        if partners.shape()[0] != count || mothers.len() != count || columns == 0 {
            return Err(input(format!(
                "expected a mother, at least one partner and a stream for each child; found {}, {:?} and {count}",
                mothers.len(),
                partners.shape()
            )));
        }
        let all = self.genomes("genomes", &genomes, genomes.shape()[0])?;
        let mothers = members(mothers.as_slice()?, genomes.shape()[0])?;
        let partners = members(partners.as_slice()?, genomes.shape()[0])?;
        self.each(py, &mut streams.0, |index, stream, child| {
            let mother = self.row(&all, mothers[index]);
            let its = &partners[index * columns..(index + 1) * columns];
            let rows = its.iter().map(|partner| self.row(&all, *partner));
            let father = Farthest::default()
                .find(mother, rows)
                .map_or(0, |index| its[index]);
            self.0
                .crossover(mother, self.row(&all, father), stream, child);
        })
    }
}

/// The operators of networks that grow.
#[pyclass(name = "GrowingNetwork", module = "swarmwright._engine", frozen)]
pub struct PyGrowingNetwork(pub GrowingNetwork);

#[pymethods]
#[expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]
impl PyGrowingNetwork {
    #[new]
    #[pyo3(signature = (*, sensors, actuators, nodes, connections, recurrent, activations, weight_range, add_node, add_connection, toggle, pattern = false))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        sensors: usize,
        actuators: usize,
        nodes: usize,
        connections: usize,
        recurrent: bool,
        activations: Vec<String>,
        weight_range: f64,
        add_node: f64,
        add_connection: f64,
        toggle: f64,
        pattern: bool,
    ) -> PyResult<Self> {
        let names = if pattern {
            PatternFunction::ALL.map(PatternFunction::name)
        } else {
            NodeActivation::ALL.map(NodeActivation::name)
        };
        let number = |name: &String| {
            let position = names.iter().position(|other| other == name);
            position
                .ok_or_else(|| input(format!("activations: {name:?} found, expected {names:?}")))
        };
        let activations: Vec<usize> = activations.iter().map(number).collect::<PyResult<_>>()?;
        let least = sensors.saturating_add(1).saturating_mul(actuators);
        if activations.is_empty() || sensors == 0 || actuators == 0 || connections < least {
            return Err(input(format!(
                "expected activations, sensors, actuators and at least {least} connections"
            )));
        }
        if nodes.max(connections) > MAX_WEIGHTS {
            return Err(input(format!(
                "at most {MAX_WEIGHTS} nodes and connections are possible"
            )));
        }
        if !weight_range.is_finite() {
            return Err(input(format!(
                "weight_range: must be a finite number, not {weight_range}"
            )));
        }
        Ok(Self(GrowingNetwork {
            sensors,
            actuators,
            nodes,
            connections,
            recurrent,
            activations,
            last_activation: names.len() - 1,
            weight_range,
            add_node,
            add_connection,
            toggle,
        }))
    }

    #[getter]
    fn genes(&self) -> usize {
        self.0.genes()
    }

    fn initial<'py>(&self, py: Python<'py>, stream: &mut PyStream) -> Bound<'py, PyArray1<f32>> {
        self.make(py, |genome| self.0.initial(&mut stream.0, genome))
    }

    #[pyo3(signature = (parent, stream, *, severity, probability))]
    fn mutate<'py>(
        &self,
        py: Python<'py>,
        parent: PyReadonlyArray1<'py, f32>,
        stream: &mut PyStream,
        severity: f64,
        probability: f64,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let parent = self.genome("genome", &parent)?;
        let weights = WeightMutation {
            genomes: 1.0,
            each: probability,
            severity,
        };
        Ok(self.make(py, |child| {
            self.0.mutated(&parent, &mut stream.0, weights, child)
        }))
    }

    fn crossover<'py>(
        &self,
        py: Python<'py>,
        mother: PyReadonlyArray1<'py, f32>,
        father: PyReadonlyArray1<'py, f32>,
        stream: &mut PyStream,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let mother = self.genome("mother", &mother)?;
        let father = self.genome("father", &father)?;
        Ok(self.make(py, |child| {
            self.0.crossover(&mother, &father, &mut stream.0, child)
        }))
    }

    fn distance(
        &self,
        genome: PyReadonlyArray1<'_, f32>,
        other: PyReadonlyArray1<'_, f32>,
    ) -> PyResult<f64> {
        let genome = self.genome("genome", &genome)?;
        let other = self.genome("other", &other)?;
        Ok(self.0.distance(&genome, &other, Compatibility::PAPER))
    }

    fn patterns<'py>(
        &self,
        py: Python<'py>,
        genomes: PyReadonlyArray2<'py, f32>,
        points: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let (network, genes) = (&self.0, self.0.genes());
        if network.recurrent || genomes.shape()[1] != genes || points.shape()[1] != network.sensors
        {
            return Err(input(format!(
                "expected a feed-forward network, genomes of {genes} genes, and points of {} coordinates",
                network.sensors
            )));
        }
        let shape = [genomes.shape()[0], points.shape()[0], network.actuators];
        let (genomes, points) = (row_major(&genomes), row_major(&points));
        let mut outputs = vec![0.0; shape.iter().product()];
        py.detach(|| {
            let rows = outputs.chunks_exact_mut((shape[1] * shape[2]).max(1));
            for (row, genome) in rows.zip(genomes.chunks_exact(genes)) {
                network.pattern(genome, &points, row);
            }
        });
        PyArray1::from_vec(py, outputs).reshape(shape)
    }
}

impl PyGrowingNetwork {
    fn make<'py>(
        &self,
        py: Python<'py>,
        fill: impl FnOnce(&mut [f32]),
    ) -> Bound<'py, PyArray1<f32>> {
        let mut genome = vec![0.0; self.0.genes()];
        fill(&mut genome);
        PyArray1::from_vec(py, genome)
    }

    fn genome<'a>(
        &self,
        name: &str,
        genome: &'a PyReadonlyArray1<'_, f32>,
    ) -> PyResult<Cow<'a, [f32]>> {
        genes(name, genome, self.0.genes())
    }
}

/// Indices of genomes, checked.
fn members(indices: &[i64], count: usize) -> PyResult<Vec<usize>> {
    // A negative one becomes too large; looking for a wrong one first is faster than stopping at each.
    let checked: Vec<usize> = indices
        .iter()
        .map(|index| index.cast_unsigned() as usize)
        .collect();
    match checked.iter().position(|index| *index >= count) {
        Some(wrong) => Err(input(format!(
            "genome {} does not exist; there are {count} genomes",
            indices[wrong]
        ))),
        None => Ok(checked),
    }
}

impl PyNodeNetwork {
    /// A new genome for each stream.
    fn each<'py>(
        &self,
        py: Python<'py>,
        streams: &mut [Stream],
        make: impl Fn(usize, &mut Stream, &mut [f32]) + Sync + Send,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let genes = self.0.genes();
        let mut genomes = vec![0.0; streams.len() * genes];
        py.detach(|| evolution::rows(streams, &mut genomes, genes, make));
        PyArray1::from_vec(py, genomes).reshape([streams.len(), genes])
    }

    fn row<'a>(&self, genomes: &'a [f32], index: usize) -> &'a [f32] {
        &genomes[index * self.0.genes()..(index + 1) * self.0.genes()]
    }

    fn genome<'a>(
        &self,
        name: &str,
        genome: &'a PyReadonlyArray1<'_, f32>,
    ) -> PyResult<Cow<'a, [f32]>> {
        genes(name, genome, self.0.genes())
    }

    fn genomes<'a>(
        &self,
        name: &str,
        genomes: &'a PyReadonlyArray2<'_, f32>,
        count: usize,
    ) -> PyResult<Cow<'a, [f32]>> {
        let expected = [count, self.0.genes()];
        if genomes.shape() != expected {
            let shape = genomes.shape();
            return Err(input(format!(
                "{name}: have the shape {shape:?}, expected {expected:?}, a genome for each stream"
            )));
        }
        Ok(row_major(genomes))
    }
}

/// The genes of a genome, checked; copied only where they do not lie side by side in memory.
fn genes<'a>(
    name: &str,
    genome: &'a PyReadonlyArray1<'_, f32>,
    expected: usize,
) -> PyResult<Cow<'a, [f32]>> {
    if genome.len() != expected {
        return Err(input(format!(
            "{name}: has {} genes, expected {expected}",
            genome.len()
        )));
    }
    Ok(match genome.as_slice() {
        Ok(genes) => genes.into(),
        Err(_) => genome.as_array().iter().copied().collect(),
    })
}

/// The numbers of an array, copied only where they do not lie row by row in memory.
pub fn row_major<'a>(genomes: &'a PyReadonlyArray2<'_, f32>) -> Cow<'a, [f32]> {
    match genomes.as_slice() {
        // There is also a slice of columns that lie one after another.
        Ok(rows) if genomes.is_c_contiguous() => rows.into(),
        _ => genomes.as_array().iter().copied().collect(),
    }
}

/// The distances of some genomes, by index, to others each: the sums of absolute differences.
#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]
pub fn distances<'py>(
    py: Python<'py>,
    genomes: PyReadonlyArray2<'py, f32>,
    ones: PyReadonlyArray1<'py, i64>,
    others: PyReadonlyArray2<'py, i64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [count, genes] = [genomes.shape()[0], genomes.shape()[1]];
    let [rows, columns] = [others.shape()[0], others.shape()[1]];
    if ones.len() != rows {
        let length = ones.len();
        return Err(input(format!(
            "ones: {length} indices, but others has {rows} rows"
        )));
    }
    let values = row_major(&genomes);
    let genome = |index: i64| match usize::try_from(index) {
        Ok(index) if index < count => Ok(&values[index * genes..(index + 1) * genes]),
        _ => Err(input(format!(
            "genome {index} does not exist; there are {count} genomes"
        ))),
    };
    let mut distances = vec![0.0; rows * columns];
    let indices = others.as_array();
    for (row, index) in ones.as_array().iter().enumerate() {
        let partners = indices
            .row(row)
            .iter()
            .map(|index| genome(*index))
            .collect::<PyResult<Vec<_>>>()?;
        let places = &mut distances[row * columns..(row + 1) * columns];
        evolution::distances(genome(*index)?, &partners, places);
    }
    distances.into_pyarray(py).reshape([rows, columns])
}
