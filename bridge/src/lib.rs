//! armwire-bridge
