//! Checks of names and numbers that clients have sent.

use super::{Refusal, RefusalCode};

/// Longest name of a scene, structure, file, rig or method, bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Longest path of a file, bytes.
pub const MAX_PATH_BYTES: usize = 4096;

/// Largest coordinate that makes sense in a local frame, m.
pub const MAX_COORDINATE_M: f64 = 1.0e6;

/// A scene's name is part of the name of a service, so it is short and plain.
pub fn check_scene_name(name: &str) -> Result<(), Refusal> {
    check_name("scene", name)?;
    let plain = |c: char| c.is_alphanumeric() || "._-+ ".contains(c);
    if !name.chars().all(plain) || name.trim() != name {
        return invalid(format!(
            "the scene name {name:?} holds other characters than letters, digits, inner spaces and `._-+`; give another with `--name`"
        ));
    }
    Ok(())
}

/// The name of the scene that a file gives, with everything replaced that a scene's name cannot hold.
pub fn plain_scene_name(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_alphanumeric() || "._-+ ".contains(c) { c } else { '-' }).collect();
    let plain = plain.trim();
    let mut end = plain.len().min(MAX_NAME_BYTES);
    while !plain.is_char_boundary(end) {
        end -= 1;
    }
    let plain = plain[..end].trim_end();
    if plain.is_empty() { "scene".into() } else { plain.into() }
}

pub(super) fn check_name(what: &str, name: &str) -> Result<(), Refusal> {
    if name.is_empty() || name.len() > MAX_NAME_BYTES || name.chars().any(char::is_control) {
        let bytes = name.len();
        return invalid(format!(
            "the {what} name is {bytes} bytes long or holds control characters; give 1 to {MAX_NAME_BYTES} bytes of plain text"
        ));
    }
    Ok(())
}

/// It may be a whole path: where the file's name says nothing, its folder's names the scene.
pub(super) fn check_file_name(name: &str) -> Result<(), Refusal> {
    if name.is_empty() || name.len() > MAX_PATH_BYTES || name.contains('\0') {
        return invalid(format!("the file name is {} bytes long or holds a zero; give 1 to {MAX_PATH_BYTES} bytes", name.len()));
    }
    Ok(())
}

pub(super) fn check_path(path: &[u8]) -> Result<(), Refusal> {
    let text = String::from_utf8_lossy(path);
    if path.len() > MAX_PATH_BYTES || path.contains(&0) || path.first() != Some(&b'/') {
        return invalid(format!(
            "the path {:?} is not an absolute path of at most {MAX_PATH_BYTES} bytes",
            text.chars().take(80).collect::<String>()
        ));
    }
    Ok(())
}

pub(super) fn check_coordinate(what: &str, value: f64) -> Result<(), Refusal> {
    if value.is_finite() && value.abs() <= MAX_COORDINATE_M {
        return Ok(());
    }
    invalid(format!("the {what} holds {value}; give finite metres of at most {MAX_COORDINATE_M} in the scene's local frame"))
}

pub(super) fn invalid(message: String) -> Result<(), Refusal> {
    Err(Refusal::new(RefusalCode::Invalid, message))
}
