//! The program as its user meets it: what commands print, what they take, and how they share a data folder.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// Two pucks that collide; nothing but ids, frames and positions is stated.
const BARE: &str = "id,frame,x,y\n1,0,0,0\n1,1,0.2,0\n1,2,0.4,0\n1,3,0.5,0\n1,4,0.51,0\n1,5,0.52,0\n\
                    2,0,0.9,0\n2,1,0.9,0\n2,2,0.9,0\n2,3,1,0\n2,4,1.18,0\n2,5,1.36,0\n";

/// A folder that is deleted at the end.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Scratch {
        let folder =
            Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("commands-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        Scratch(folder)
    }

    fn write(&self, name: &str, text: &str) -> String {
        let file = self.0.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, text).unwrap();
        file.display().to_string()
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn vrdp(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vrdp"));
    command.args(words).stdin(Stdio::null());
    for name in ["VRDP_SERVER", "VRDP_CA", "VRDP_TOKEN"] {
        command.env_remove(name);
    }
    command
}

fn run(words: &[&str]) -> (Output, String, String) {
    let output = vrdp(words).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    (output, out, err)
}

/// A service that is stopped at the end.
struct Service(Child);

impl Service {
    /// Starts a service; when this returns, it accepts calls.
    fn start(data_dir: &str) -> Service {
        let words = ["serve", "--listen", "127.0.0.1:0", "--http", "", "--data-dir", data_dir];
        let mut child = vrdp(&words).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert!(line.contains("serves gRPC"), "{line}");
        Service(child)
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let _ = self.0.wait();
    }
}

fn scene(name: &str) -> String {
    format!("{}/tests/data/clevrer/{name}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn a_result_says_what_was_assumed_and_what_to_try_next() {
    let scratch = Scratch::new("assumed");
    let video = scratch.write("bare.csv", BARE);
    let json = scratch.path("bare.json");
    let (output, out, _) = run(&["fit", &video, "--json", &json]);
    assert!(output.status.success(), "{out}");
    for words in [
        "radius or half side of 0.2 m (`# size: 30 mm`)",
        "25 frames per second (`# fps: 50`)",
        "world table, which selects the preset",
        "masses and forces (N) are relative",
        "contact",
        "e = coefficient r_a r_b d_ab",
        "\nnext: vrdp ",
    ] {
        assert!(out.contains(words), "{words}: {out}");
    }
    let written = fs::read_to_string(&json).unwrap();
    assert!(written.contains("\"assumed\":[\"radius"), "{written}");
    assert!(written.contains("\"pairs\":[{\"object_ids\":[1,2]"), "{written}");
    let (_, out, _) = run(&["fit", &video, "--quiet"]);
    assert!(!out.contains("next:"), "{out}");
}

#[test]
fn errors_name_what_the_user_typed() {
    let scratch = Scratch::new("errors");
    let video = scratch.write("bare.csv", BARE);
    for (words, expected) in [
        (&["effects", "wind"][..], "did you mean uniform_force?"),
        (&["simulate", &video, "--mass", "1=1e300"], "--mass 1=1e300: is 1e300; must be from"),
        (&["simulate", &video, "--mass", "1=inf"], "give a finite number"),
        (&["simulate", &video, "--remove", "7"], "object 7 is not in the model"),
        (
            &["simulate", &video, "--without", "gravity"],
            "effect \"gravity\" is not in the model, whose effects are",
        ),
        (&["revise", &video, "--add-formula", "ax = -0.1*vx**2"], "write ^ for a power"),
        (&["revise", &video, "--add-formula", "let k [kg] = 1; ax = -k*vx"], "k [kg] would have to be 1/s"),
        (&["revise", &video, "--add", "coriolys"], "did you mean coriolis"),
        (&["fit", &video, "--threads", "0"], "workers"),
        (&["fitt", &video], "similar subcommand exists: 'fit'"),
        (&["import", &scratch.path("no.csv")], "no.csv: "),
    ] {
        let (output, _, err) = run(words);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {err}");
        assert!(err.contains(expected), "{words:?}: {err}");
        assert!(!err.contains("interventions"), "{words:?}: {err}");
        assert!(err.matches("no.csv").count() <= 1, "the file is named once: {err}");
    }
}

#[test]
fn a_command_uses_the_service_that_holds_its_data_folder() {
    let scratch = Scratch::new("shared");
    let lab = scratch.path("lab");
    let service = Service::start(&lab);
    let (output, out, err) = run(&["effects", "coriolis", "--data-dir", &lab]);
    assert!(output.status.success() && out.starts_with("coriolis"), "{err}");
    assert!(err.contains("using the service at http://127.0.0.1:"), "{err}");
    drop(service);
    assert!(!scratch.0.join("lab/service-url").exists());
}

#[test]
fn a_command_waits_for_its_data_folder() {
    let scratch = Scratch::new("waits");
    let lab = scratch.path("lab");
    let service = Service::start(&lab);
    // Now the folder is held as another command holds it: without a service for others.
    fs::remove_file(scratch.0.join("lab/service-url")).unwrap();
    let words = ["effects", "coriolis", "--data-dir", &lab];
    let mut waiting = vrdp(&words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let mut err = BufReader::new(waiting.stderr.take().unwrap());
    err.read_line(&mut line).unwrap();
    assert!(line.starts_with("waiting for another command, which uses the data folder"), "{line}");
    assert!(waiting.try_wait().unwrap().is_none());
    drop(service);
    let output = waiting.wait_with_output().unwrap();
    assert!(output.status.success() && output.stdout.starts_with(b"coriolis"));
}

#[test]
fn clevrers_own_layout_is_scored_and_written_for_its_evaluation() {
    let scratch = Scratch::new("clevrer");
    let folder = "annotation_validation/annotation_00000-01000";
    let observed = fs::read_to_string(scene("scene_00022") + "/observed.json").unwrap();
    scratch.write(&format!("{folder}/annotation_00022.json"), &observed);
    let questions = fs::read_to_string(scene("scene_00022") + "/questions.json").unwrap();
    // One right answer is changed: that question is then answered wrongly.
    let changed = questions.replacen("\"answer\": \"no\"", "\"answer\": \"yes\"", 1);
    assert_ne!(changed, questions);
    scratch.write("validation.json", &format!("[{changed}]"));
    let submission = scratch.path("submission.json");
    let place = scratch.path("annotation_validation");
    let (output, out, err) = run(&["score", &place, "--wrong", "--submission", &submission]);
    assert!(output.status.success(), "{err}");
    let mistake = "annotation_00022, question 0 (descriptive): Are there any metal objects that exit the scene?\n  \
                   said: no; right: yes\n";
    assert!(out.contains(mistake), "{out}");
    assert!(out.contains("exist"), "the steps: {out}");
    let written = fs::read_to_string(&submission).unwrap();
    assert!(written.starts_with("[{\"questions\":[{\"answer\":\"no\",\"question_id\":0}"), "{written}");
    assert!(written.trim_end().ends_with("\"scene_index\":22}]"), "{written}");
    // The same folder is taken by the other commands.
    let (output, _, err) = run(&["ask", &place, "--question", "How many objects are moving?"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(err.contains("is a folder of scenes; give one of them, such as"), "{err}");
    let (output, out, err) = run(&["fit", &place]);
    assert!(output.status.success() && out.contains("annotation_00022"), "{err}");
}

#[test]
fn tables_of_other_programs_go_into_every_command() {
    let scratch = Scratch::new("dialects");
    std::fs::create_dir(scratch.path("videos")).unwrap();
    let mut rows = String::from("#multi:\n\tmass A\t\tmass B\t\nt\tx\ty\tx\ty\n");
    for k in 0..12 {
        rows += &format!("{}\t{}\t0,0\t5,0\tNA\n", 0.04 * k as f64, 0.02 * k as f64)
            .replace("NA", "1,0")
            .replace('.', ",");
    }
    scratch.write("videos/one.txt", &rows);
    scratch.write("videos/notes.txt", "Recorded on Monday.\n");
    let out = scratch.path("csv");
    let (output, text, err) =
        run(&["convert", &scratch.path("videos/one.txt"), "--out", &out, "--size", "0.03"]);
    assert!(output.status.success(), "{err}");
    assert!(
        text.contains("tabs, decimal commas, 25 frames/s") && text.contains("0 is mass A, 1 is mass B"),
        "{text}"
    );
    // The folder of the text and the folder of what it became hold the same video.
    for folder in [scratch.path("videos"), out] {
        let (output, text, err) = run(&["fit", &folder, "--json", "-"]);
        assert!(output.status.success() && text.contains("\"one\""), "{text}{err}");
    }
    let tracks = scratch.write("tracks.h5", "\u{1}");
    std::fs::write(&tracks, b"\x89HDF\r\n\x1a\n").unwrap();
    let (output, _, err) = run(&["fit", &tracks]);
    assert!(output.status.code() == Some(2) && err.contains("save_as_csv=True"), "{err}");
}

/// Position (m) of each object by frame, in a scene file, and what it looks like.
fn objects(file: &str) -> Vec<(String, std::collections::BTreeMap<u64, [f64; 2]>)> {
    let root: serde_json::Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
    let property = root["object_property"].as_array().unwrap();
    let of = |object: &serde_json::Value| {
        let look =
            ["color", "material", "shape"].map(|key| object[key].as_str().unwrap().to_string()).join(" ");
        let frames = root["motion_trajectory"].as_array().unwrap();
        let at = |frame: &serde_json::Value| {
            let seen = frame["objects"].as_array()?.iter().find(|o| o["object_id"] == object["object_id"])?;
            let place = [seen["location"][0].as_f64()?, seen["location"][1].as_f64()?];
            (seen["inside_camera_view"] == true).then_some((frame["frame_id"].as_u64()?, place))
        };
        (look, frames.iter().filter_map(at).collect())
    };
    property.iter().map(of).collect()
}

#[test]
fn a_result_that_cannot_be_written_is_refused_at_once() {
    let (done, out, err) = run(&["parse", "--operations", "--json", "/nowhere/operations.json"]);
    assert!(done.status.code() == Some(2) && err.contains("give a writable file"), "{err}");
    assert_eq!(out, "");
}

#[test]
fn a_video_becomes_tracks_near_those_that_were_measured() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let video = root.join("videos/scene_00011/video.mp4").display().to_string();
    let camera = root.join("videos/scene_00011/camera.json").display().to_string();
    let scratch = Scratch::new("video");
    let (done, out, err) = run(&["import", &video, "--camera", &camera, "--out", &scratch.path("seen")]);
    assert!(done.status.success(), "{out}{err}");
    assert!(out.contains("H.264 in MP4"), "{out}");
    assert!(
        fs::read_to_string(scratch.path("seen/scene_00011/perception.json")).unwrap().contains("unexplained")
    );
    let found = objects(&scratch.path("seen/scene_00011/observed.json"));
    let known = objects(&root.join("clevrer/scene_00011/observed.json").display().to_string());
    assert_eq!(found.len(), known.len());
    for (look, places) in &found {
        let (_, measured) = known.iter().find(|(other, _)| other == look).unwrap_or_else(|| panic!("{look}"));
        let off = |(frame, at): (&u64, &[f64; 2])| {
            measured.get(frame).map(|other| (other[0] - at[0]).abs().max((other[1] - at[1]).abs()))
        };
        let mut off: Vec<f64> = places.iter().filter_map(off).collect();
        off.sort_by(f64::total_cmp);
        // Measurements have a noise of 5 mm.
        assert!(off.len() > 60 && off[off.len() / 2] < 0.015, "{look}: {:?}", off.get(off.len() / 2));
    }
    // A folder with a video is a scene; one that ends too soon says so.
    let folder = root.join("videos/scene_00011").display().to_string();
    let (done, out, err) = run(&["fit", &folder]);
    assert!(done.status.success() && out.contains("reduced chi-square"), "{out}{err}");
    let whole = fs::read(&video).unwrap();
    let cut = scratch.path("cut.mp4");
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let (done, _, err) = run(&["import", &cut, "--out", &scratch.path("seen")]);
    assert!(!done.status.success() && err.contains("cut.mp4") && err.contains("again"), "{err}");
}

#[cfg(not(feature = "onnx"))]
#[test]
fn a_detector_needs_a_program_that_was_built_with_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let video = root.join("videos/scene_00011/video.mp4").display().to_string();
    let model = root.join("onnx/masks.onnx").display().to_string();
    let (done, _, err) = run(&["import", &video, "--detector", &model]);
    assert!(!done.status.success() && err.contains("cargo build --release --features onnx"), "{err}");
}

/// Needs ONNX Runtime: `ORT_DYLIB_PATH` is the path of its library.
#[cfg(feature = "onnx")]
#[test]
fn a_users_own_network_finds_the_objects_of_a_video() {
    assert!(
        std::env::var_os("ORT_DYLIB_PATH").is_some(),
        "set ORT_DYLIB_PATH to the library of ONNX Runtime"
    );
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let video = root.join("videos/scene_00011/video.mp4").display().to_string();
    let known = objects(&root.join("clevrer/scene_00011/observed.json").display().to_string());
    let scratch = Scratch::new("detector");
    for model in ["masks", "boxes"] {
        let (out, file) =
            (scratch.path(model), root.join(format!("onnx/{model}.onnx")).display().to_string());
        let (done, text, err) = run(&["import", &video, "--detector", &file, "--noise", "2", "--out", &out]);
        assert!(
            done.status.success() && text.contains(&format!("detections by {model}.onnx")),
            "{text}{err}"
        );
        let scene = format!("{out}/scene_00011/observed.json");
        let written: serde_json::Value = serde_json::from_str(&fs::read_to_string(&scene).unwrap()).unwrap();
        for object in written["object_property"].as_array().unwrap() {
            let rgb: Vec<f64> =
                object["features"].as_array().unwrap().iter().filter_map(|f| f.as_f64()).collect();
            assert!(rgb.len() == 3 && rgb[0] > rgb[1] && rgb[1] > 0.95 * rgb[2], "{object}");
        }
        let found = objects(&scene);
        assert_eq!(found.len(), known.len(), "{text}");
        for (look, places) in &found {
            let (_, measured) =
                known.iter().find(|(other, _)| other == look).unwrap_or_else(|| panic!("{look}"));
            let off = |(frame, at): (&u64, &[f64; 2])| {
                measured.get(frame).map(|other| (other[0] - at[0]).abs().max((other[1] - at[1]).abs()))
            };
            let mut off: Vec<f64> = places.iter().filter_map(off).collect();
            off.sort_by(f64::total_cmp);
            println!("{model}: {look}: {} frames, median {:.3} m off", off.len(), off[off.len() / 2]);
            // Half a body's size: such a network sees shades, not outlines.
            assert!(off.len() > 60 && off[off.len() / 2] < 0.1, "{look}: {}", off[off.len() / 2]);
        }
    }
}

#[cfg(feature = "onnx")]
#[test]
fn what_a_detector_lacks_is_named() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let video = root.join("videos/scene_00011/video.mp4").display().to_string();
    let model = root.join("onnx/masks.onnx");
    let scratch = Scratch::new("no_detector");
    let bare = scratch.path("bare.onnx");
    fs::copy(&model, &bare).unwrap();
    let model = model.display().to_string();
    let import = |model: &str, library: Option<&str>| {
        let mut command = vrdp(&["import", &video, "--detector", model]);
        command.envs(library.map(|path| ("ORT_DYLIB_PATH", path)));
        let done = command.output().unwrap();
        assert!(!done.status.success());
        String::from_utf8_lossy(&done.stderr).into_owned()
    };
    let said = import(&model, Some("/nowhere/libonnxruntime.so"));
    assert!(said.contains("set ORT_DYLIB_PATH") && said.contains("pip install onnxruntime"), "{said}");
    let said = import(&bare, None);
    assert!(said.contains("bare.json: is missing; write what the outputs of the model are"), "{said}");
    let wrong = scratch.write("bare.json", r#"{"output": "masks", "names": {"masks": "mask"}}"#);
    let said = import(&bare, None);
    assert!(said.contains("names: the model has no output \"mask\"; it has logits, colour"), "{said}");
    let said = import(&wrong, None);
    assert!(said.contains("is not read by ONNX Runtime"), "{said}");
}

/// Words learned from the questions of some scenes answer those of another, whose labels are wrong.
#[test]
fn words_are_learned_from_questions_and_shown_and_used() {
    let scratch = Scratch::new("words");
    let scene = |k: usize| {
        let colors: Vec<&str> = (0..3).map(|id| if (k >> id) & 1 == 1 { "red" } else { "blue" }).collect();
        let object = |(id, color): (usize, &&str)| {
            let chroma = if *color == "red" { 0.8 } else { -0.8 } + 0.05 * (k % 3) as f64;
            format!(
                r#"{{"object_id": {id}, "color": "green", "material": "rubber", "shape": "cube", "features": [{chroma}, 0.3]}}"#
            )
        };
        let objects: Vec<String> = colors.iter().enumerate().map(object).collect();
        let at = |frame: usize, id: usize| {
            format!(r#"{{"object_id": {id}, "location": [{}, {id}.0, 0.2]}}"#, 0.02 * frame as f64)
        };
        let frame = |f: usize| {
            let all: Vec<String> = (0..3).map(|id| at(f, id)).collect();
            format!(r#"{{"frame_id": {f}, "objects": [{}]}}"#, all.join(", "))
        };
        let frames: Vec<String> = (0..12).map(frame).collect();
        let (objects, frames) = (objects.join(", "), frames.join(", "));
        let observed = format!(
            r#"{{"feature_layout": "chroma-1", "object_property": [{objects}], "motion_trajectory": [{frames}]}}"#
        );
        scratch.write(&format!("s{k}/observed.json"), &observed);
        let count = |word: &str| colors.iter().filter(|c| **c == word).count();
        let question = |(id, word): (usize, &&str)| {
            format!(
                r#"{{"question_id": {id}, "question_type": "descriptive", "question": "How many {word} objects are there?",
                    "program": ["objects", "{word}", "filter_color", "count"], "answer": "{}"}}"#,
                count(word)
            )
        };
        let questions: Vec<String> = ["red", "blue"].iter().enumerate().map(question).collect();
        scratch.write(
            &format!("s{k}/questions.json"),
            &format!(r#"{{"questions": [{}]}}"#, questions.join(", ")),
        );
        scratch.path(&format!("s{k}"))
    };
    let folders: Vec<String> = (0..7).map(scene).collect();
    let lexicon = scratch.path("words.json");
    let mut learn = vec!["learn", "--lexicon", &lexicon, "--programs", "--observed-only"];
    learn.extend(folders[..6].iter().map(String::as_str));
    let (output, out, err) = run(&learn);
    assert!(output.status.success() && out.contains("red") && out.contains("blue"), "{out}{err}");
    let learned = fs::read(&lexicon).unwrap();
    assert!(run(&learn).0.status.success() && fs::read(&lexicon).unwrap() == learned, "equal bytes");
    let (output, out, err) = run(&["words", &lexicon, "red"]);
    assert!(output.status.success() && out.contains("near blue"), "{out}{err}");
    let score = ["score", &folders[6], "--programs", "--lexicon", &lexicon, "--answers", "-"];
    let (output, out, err) = run(&score);
    assert!(
        output.status.success() && out.contains(r#""0":"2""#) && out.contains(r#""1":"1""#),
        "{out}{err}"
    );
    let (output, out, _) = run(&["score", &folders[6], "--programs", "--answers", "-"]);
    assert!(output.status.success() && !out.contains(r#""0":"2""#), "labels say green: {out}");
    let bare = scratch.write(
        "bare/observed.json",
        &fs::read_to_string("tests/data/clevrer/scene_00000/observed.json").unwrap(),
    );
    let questions = fs::read_to_string("tests/data/clevrer/scene_00000/questions.json").unwrap();
    scratch.write("bare/questions.json", &questions);
    let (output, _, err) =
        run(&["learn", "--lexicon", &scratch.path("no.json"), &bare.replace("/observed.json", "")]);
    assert!(!output.status.success() && err.contains("features"), "{err}");
}
