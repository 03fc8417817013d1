//! The service over loopback: a small world, real sockets, port 0.
//!
//! `light` follows the main path with the client library; `faults` speaks raw gRPC and raw TCP, and does
//! what no client should; `solver` changes solvers under a client; `credentials` is about tokens and
//! TLS, `ends` about how the service starts, refuses to start and stops.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails, in its helpers too")]

mod credentials;
mod ends;
mod faults;
mod light;
mod plates;
mod solver;
mod world;
