//! The resident daemon.
