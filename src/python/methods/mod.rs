//! The methods' parameters as Python has them: a file a method, and the table of their names.

pub(super) mod accumulation;
pub(super) mod convolution;
pub(super) mod filtered;
pub(super) mod layered;
pub(super) mod ray_traced;
pub(super) mod single_sample;
pub(super) mod ssoc;
pub(super) mod wedges;

use std::sync::Arc;

use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::method::Method;
use crate::methods::hard::Hard;
use crate::methods::layered::LayerKind;
use accumulation::AccumulationParameters;
use convolution::ConvolutionParameters;
use filtered::{DeepParameters, MvsmParameters, PcfParameters};
use layered::LayeredParameters;
use ray_traced::RayTracedParameters;
use single_sample::SingleSampleParameters;
use ssoc::SsocParameters;
use wedges::{VolumeParameters, WedgeParameters};

/// Makes a method from its Python object, whose attributes are the parameters.
type Make = fn(&Bound<'_, PyAny>) -> PyResult<Arc<dyn Method>>;

/// Every method by its name.
const METHODS: [(&str, Make); 14] = [
    ("accumulation", |m| {
        made(m.extract::<AccumulationParameters>()?.parse())
    }),
    ("convolution", |m| {
        made(m.extract::<ConvolutionParameters>()?.parse())
    }),
    ("deep", |m| made(m.extract::<DeepParameters>()?.parse())),
    ("hard", |_| made(Ok(Hard))),
    ("mlsm", |m| {
        made(m.extract::<LayeredParameters>()?.parse(LayerKind::Multi))
    }),
    ("mtsm", |m| {
        made(
            m.extract::<LayeredParameters>()?
                .parse(LayerKind::Transparent),
        )
    }),
    ("mvsm", |m| made(m.extract::<MvsmParameters>()?.parse())),
    ("pcf", |m| made(m.extract::<PcfParameters>()?.parse())),
    ("ray_traced", |m| {
        made(m.extract::<RayTracedParameters>()?.parse())
    }),
    ("shadow_volume", |m| {
        made(m.extract::<VolumeParameters>()?.parse())
    }),
    ("single_sample", |m| {
        made(m.extract::<SingleSampleParameters>()?.parse())
    }),
    ("slsm", |m| {
        made(m.extract::<LayeredParameters>()?.parse(LayerKind::Single))
    }),
    ("ssoc", |m| made(m.extract::<SsocParameters>()?.parse())),
    ("wedges", |m| made(m.extract::<WedgeParameters>()?.parse())),
];

/// A method whose parameters are right.
fn made(method: Result<impl Method + 'static>) -> PyResult<Arc<dyn Method>> {
    Ok(Arc::new(method?))
}

/// A method with its parameters.
#[pyclass(name = "Method", module = "softshadow._core", frozen)]
pub(super) struct PyMethod(pub(super) Arc<dyn Method>);

#[pymethods]
impl PyMethod {
    #[new]
    fn new(name: &str, parameters: &Bound<'_, PyAny>) -> PyResult<Self> {
        let Some((_, make)) = METHODS.iter().find(|m| m.0 == name) else {
            let names: Vec<_> = METHODS.iter().map(|m| m.0).collect();
            let reason = format!("unknown name {name:?}, known are {}", names.join(", "));
            return Err(Error::parameter("method", reason).into());
        };
        make(parameters).map(PyMethod)
    }
}
