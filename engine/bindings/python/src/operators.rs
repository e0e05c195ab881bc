//! Genetic operators: the engine's own, or those of a representation in Python.

use numpy::{
    AllowTypeChange, IntoPyArray, PyArray1, PyArray2, PyArrayLike2, PyArrayMethods,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyTuple};
use swarmwright_evolution::{Operators, Stream, Unavailable, Variation};

use crate::conversation::Failure;
use crate::errors::input;
use crate::evolution::{PyGrowingNetwork, PyNodeNetwork};
use crate::local::lock;
use crate::streams::PyStreams;

/// Operators of the engine's, or a representation in Python, whose errors go to `failed`.
pub fn operators(
    object: &Bound<'_, PyAny>,
    genes: usize,
    failed: Failure,
) -> PyResult<Box<dyn Operators>> {
    let operators: Box<dyn Operators> = if let Ok(network) = object.cast::<PyNodeNetwork>() {
        Box::new(network.get().0.clone())
    } else if let Ok(network) = object.cast::<PyGrowingNetwork>() {
        Box::new(network.get().0.clone())
    } else {
        Box::new(InPython {
            representation: object.clone().unbind(),
            genes,
            failed,
        })
    };
    if operators.genes() != genes {
        return Err(input(format!(
            "operators: genomes have {genes} genes, those of the network {}",
            operators.genes()
        )));
    }
    Ok(operators)
}

struct InPython {
    representation: Py<PyAny>,
    genes: usize,
    failed: Failure,
}

impl InPython {
    /// What a method of the representation returns, for arrays and numbers that `arguments` makes.
    fn call<'a>(
        &self,
        name: &str,
        out: &mut [f32],
        streams: &[Stream],
        arguments: impl FnOnce(Python<'_>, Py<PyStreams>) -> PyResult<(Py<PyTuple>, Option<Variation>)>
        + 'a,
    ) -> Result<(), Unavailable> {
        Python::attach(|py| {
            let streams = Py::new(py, PyStreams(streams.to_vec()))?;
            let (arguments, variation) = arguments(py, streams)?;
            let named = variation
                .map(|how| {
                    let values = [("severity", how.severity), ("probability", how.probability)];
                    values.into_py_dict(py)
                })
                .transpose()?;
            let array = self
                .representation
                .bind(py)
                .call_method(name, arguments, named.as_ref())?;
            let array: PyArrayLike2<'_, f32, AllowTypeChange> = array.extract()?;
            let expected = [out.len() / self.genes, self.genes];
            if array.shape() != expected {
                let shape = array.shape();
                return Err(input(format!(
                    "{name}: returned the shape {shape:?}, expected {expected:?}, a genome for each stream"
                )));
            }
            for (slot, gene) in out.iter_mut().zip(array.as_array()) {
                *slot = *gene;
            }
            Ok(())
        })
        .map_err(|error: PyErr| {
            *lock(&self.failed) = Some(error);
            Unavailable
        })
    }

    fn array<'py>(&self, py: Python<'py>, genomes: &[f32]) -> PyResult<Bound<'py, PyArray2<f32>>> {
        PyArray1::from_slice(py, genomes).reshape([genomes.len() / self.genes, self.genes])
    }
}

impl Operators for InPython {
    fn genes(&self) -> usize {
        self.genes
    }

    fn initials(&self, streams: &mut [Stream], genomes: &mut [f32]) -> Result<(), Unavailable> {
        self.call("initials", genomes, streams, |py, streams| {
            Ok(((streams,).into_pyobject(py)?.unbind(), None))
        })
    }

    fn mutations(
        &self,
        genomes: &[f32],
        parents: &[usize],
        streams: &mut [Stream],
        mutation: Variation,
        children: &mut [f32],
    ) -> Result<(), Unavailable> {
        self.call("mutations", children, streams, |py, streams| {
            let mut chosen = Vec::with_capacity(parents.len() * self.genes);
            for parent in parents {
                chosen.extend_from_slice(&genomes[parent * self.genes..][..self.genes]);
            }
            let chosen = PyArray1::from_vec(py, chosen).reshape([parents.len(), self.genes])?;
            Ok((
                (chosen, streams).into_pyobject(py)?.unbind(),
                Some(mutation),
            ))
        })
    }

    fn matings(
        &self,
        genomes: &[f32],
        mothers: &[usize],
        partners: &[usize],
        streams: &mut [Stream],
        children: &mut [f32],
    ) -> Result<(), Unavailable> {
        self.call("matings", children, streams, |py, streams| {
            let genomes = self.array(py, genomes)?;
            let columns = partners.len() / mothers.len().max(1);
            let partners = indices(py, partners).reshape([mothers.len(), columns])?;
            let arguments = (genomes, indices(py, mothers), partners, streams);
            Ok((arguments.into_pyobject(py)?.unbind(), None))
        })
    }
}

fn indices<'py>(py: Python<'py>, indices: &[usize]) -> Bound<'py, PyArray1<i64>> {
    let indices: Vec<i64> = indices.iter().map(|index| *index as i64).collect();
    indices.into_pyarray(py)
}
