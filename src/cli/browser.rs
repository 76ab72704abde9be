//! The browser of the desktop.

use std::ffi::OsStr;

/// Opens a file or an address with the program that the desktop has for pages.
pub fn open(target: impl AsRef<OsStr>) -> Result<(), String> {
    let has_desktop = cfg!(not(target_os = "linux"))
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|variable| std::env::var_os(variable).is_some_and(|value| !value.is_empty()));
    if !has_desktop {
        return Err("there is no desktop".to_owned());
    }
    open::that_detached(target).map_err(|error| error.to_string())
}
