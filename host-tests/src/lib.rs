//! armwire-host-tests
