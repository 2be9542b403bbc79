//! vrdp understands the physics in videos of moving objects: it fits, predicts, answers questions, and finds the effect
//! that a model lacks.
//!
//! # The map
//!
//! From the ground up; a module uses only those above it in this list. Up to [`concepts`] all are functions of plain data:
//! they know no files, clocks, tasks or messages.
//!
//! - [`num`]: scalars with and without derivatives, plane vectors, numerical methods.
//! - [`scene`]: what was observed: objects, tracks, camera and table; their files.
//! - [`media`]: video files to frames with their times.
//! - [`perception`]: frames to tracks: which bodies a video shows, and where they are.
//! - [`body`]: what an effect may read and change.
//! - [`effects`]: one law per file, and the table of all.
//! - [`world`]: the model and its simulation with exact contacts.
//! - [`fit`]: parameters of a model with their posterior.
//! - [`discover`]: which effect a model lacks, and what adding it is worth.
//! - [`reason`]: predictions, counterfactuals, and answers to questions.
//! - [`concepts`]: words learned from questions and answers, and from a few examples.
//! - [`store`], [`recording`], [`report`]: the database, trace files, and pages with pictures.
//! - [`engine`]: computes each result once, on a bounded pool of threads, and keeps it.
//! - [`api`]: the gRPC and HTTP services.
//! - [`config`], [`telemetry`]: settings and logs.
//! - [`cli`]: the commands; each is a client of the service.
//!
//! # From tracks to a coefficient of friction
//!
//! ```
//! use vrdp::fit::{FitOptions, fit};
//! use vrdp::num::never;
//! use vrdp::scene::parse_csv;
//! use vrdp::world::Preset;
//!
//! // A puck slides at 1 m/s and is slowed by friction of mu = 0.05: x = v t - mu g t^2 / 2, in mm.
//! let x = |t: f64| 1e3 * (1.0 * t - 0.05 * 9.81 * t * t / 2.0);
//! let rows: String = (0..25).map(|frame| format!("1,{frame},{:.1},0\n", x(f64::from(frame) / 25.0))).collect();
//! let scene = parse_csv("puck", &format!("# fps: 25\n# size: 50 mm\nid,frame,x [mm],y [mm]\n{rows}"))?;
//!
//! let model = Preset::for_world(scene.world).model(&scene);
//! let fit = fit(&[scene], &[model], &FitOptions::default(), &never)?;
//!
//! let friction = fit.posterior.estimates.iter().find(|e| e.name.starts_with("gliding_friction.sliding")).unwrap();
//! assert!(friction.identified && (friction.value - 0.05).abs() < 3.0 * friction.sd);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Tests may compare with the C library.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod api;
pub mod body;
pub mod cli;
pub mod concepts;
pub mod config;
pub mod discover;
pub mod effects;
pub mod engine;
pub mod fit;
pub mod media;
pub mod num;
pub mod perception;
pub mod reason;
pub mod recording;
pub mod report;
pub mod scene;
pub mod store;
pub mod telemetry;
pub mod world;
