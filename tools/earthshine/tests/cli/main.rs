//! The command as a user meets it: the real program, its exit codes and what it says.
//!
//! `main_path` goes all the way from `gen` to `fly`; `defaults` says nothing and looks at what is chosen;
//! `accuracy` and `moving_light` measure, `methods` draws; `devices` lists and measures graphics adapters, or does without;
//! `scenes`, `lights`, `words`, `worlds`, `service` and
//! `disk_full` hand it what nobody should, and check the documented exit code, a message that names file, cause and
//! cure, and that nothing half-written stays. What a client may do to a server is tested beside the server.

mod accuracy;
mod command;
mod defaults;
mod devices;
mod disk_full;
mod glb;
mod lights;
mod main_path;
mod methods;
mod moving_light;
mod scenes;
mod service;
mod words;
mod worlds;
