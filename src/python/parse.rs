//! What users write as names and numbers, as the core has it.

use crate::error::{Error, Result};
use crate::light::falloff::Falloff;

/// The value that a name stands for.
pub(super) fn choice<T: Copy>(
    method: &str,
    parameter: &str,
    name: &str,
    values: &[(&str, T)],
) -> Result<T> {
    let found = values.iter().find(|v| v.0 == name);
    found.map(|v| v.1).ok_or_else(|| {
        let names: Vec<String> = values.iter().map(|v| format!("{:?}", v.0)).collect();
        let reason = format!(
            "{parameter} must be one of {}, got {name:?}",
            names.join(", ")
        );
        Error::parameter(method, reason)
    })
}

/// How pictures read textures.
pub(super) const INTERPOLATIONS: [(&str, bool); 2] = [("linear", true), ("nearest", false)];

/// Bytes that a method may take.
pub(super) fn parse_memory(method: &str, bytes: f64) -> Result<usize> {
    if bytes.is_nan() || bytes <= 0.0 {
        let reason = format!("memory_limit must be positive, got {bytes}");
        return Err(Error::parameter(method, reason));
    }
    Ok(bytes as usize)
}

/// The falloffs that do without planes.
pub(super) fn parse_falloff(method: &str, name: &str) -> Result<Falloff> {
    let falloffs = [
        ("light", Falloff::Light),
        ("linear", Falloff::Linear),
        ("smooth", Falloff::Smooth),
    ];
    choice(method, "falloff", name, &falloffs)
}

/// A whole number as the core has it; what does not fit stays out of every range.
pub(super) fn whole(value: i64) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

/// Whether all that casts blocks all light.
pub(super) fn parse_opaque(method: &str, name: Option<&str>) -> Result<bool> {
    name.map_or(Ok(false), |name| {
        choice(method, "opacity", name, &[("opaque", true)])
    })
}
