//! CSV files as users write them, and wrong ones.

use super::*;
use crate::num::vec2;
use crate::scene::{Sample, Shape, Table, WorldKind};
use proptest::prelude::*;
use std::f64::consts::PI;

#[test]
fn tracks_are_read_in_their_units() {
    let text = "# A puck and a ball.\n# fps: 50\n# world: air_table\n# size: 0.03\n\
                id;t [ms];x_mm;y (cm);yaw [deg];visible;shape;mass_g\n\
                7;0;1000;-20;90;1;disc;250\n9;0;0;0;;1;ball;\n7;20;1010;-20;180;1;disc;250\n9;20;;;;1;ball;\n\
                9;40;5;1;;0;ball;\n7;40;1020;-20;270;yes;disc;250\n9;60;30;1;;1;ball;\n";
    let scene = parse_csv("lab", text).expect("it is right");
    assert_eq!((scene.name.as_str(), scene.world, scene.fps), ("lab", WorldKind::AirTable, 50.0));
    assert_eq!(scene.times, [0.0, 0.02, 0.04, 0.06]);
    let shapes: Vec<_> = scene.objects.iter().map(|o| (o.id, o.shape, o.mass)).collect();
    assert_eq!(
        shapes,
        [(7, Shape::Disc { radius: 0.03 }, Some(0.25)), (9, Shape::Ball { radius: 0.03 }, None)]
    );
    let frames: Vec<Vec<usize>> =
        scene.tracks.iter().map(|t| t.samples.iter().map(|s| s.frame).collect()).collect();
    assert_eq!(frames, [vec![0, 1, 2], vec![0, 3]]);
    let first = scene.tracks[0].samples[1];
    assert_eq!((first.position, first.yaw), (vec2(1.01, -0.2), Some(PI)));
}

#[test]
fn the_tutorials_videos_are_those_of_the_annotations() {
    let table = include_str!("../../../../tests/data/csv/video_1.csv");
    let known = include_str!("../../../../tests/data/effects/bullet_coriolis_medium/scene_00/observed.json");
    let (read, known) =
        (parse_csv("v", table).expect("rows"), crate::scene::parse("v", known).expect("json"));
    assert_eq!((read.world, read.times.len()), (known.world, known.times.len()));
    for ((a, b), (p, q)) in read.objects.iter().zip(&known.objects).zip(read.tracks.iter().zip(&known.tracks))
    {
        assert_eq!((a.id, a.shape, a.mass, &a.material), (b.id, b.shape, b.mass, &b.material));
        assert_eq!(p.samples.len(), q.samples.len());
        let near = |(s, t): (&Sample, &Sample)| s.frame == t.frame && (s.position - t.position).norm() < 2e-5;
        assert!(p.samples.iter().zip(&q.samples).all(near));
    }
}

#[test]
fn frames_count_at_the_rate_and_pixels_need_a_scale() {
    let rows = "frame,id,x,y\n0,1,100,100\n2,1,120,100\n3,1,130,100\n";
    let scaled = parse_csv("s", &format!("# unit: px\n# scale: 0.001 m/px\n{rows}")).expect("it is right");
    assert_eq!(scaled.times, [0.0, 0.04, 0.08, 0.12]);
    assert_eq!(scaled.tracks[0].samples[1].position, vec2(0.12, 0.1));
    let sized = parse_csv("s", &format!("# size: 20\n# unit: cm\n{rows}")).expect("it is right");
    assert_eq!(sized.objects[0].shape, Shape::Disc { radius: 0.2 });
    let own = parse_csv("s", &format!("# size: 30 mm\n# unit: cm\n{rows}")).expect("it is right");
    assert_eq!(own.objects[0].shape, Shape::Disc { radius: 0.03 });
    let unknown = parse_csv("s", &format!("# size: 30 inch\n{rows}")).expect_err("unknown").to_string();
    assert!(unknown.starts_with("line 1: size has an unknown unit"), "{unknown}");
    for slip in ["# size [mm]: 30", "# Size = 30 mm"] {
        let refused = parse_csv("s", &format!("{slip}\n{rows}")).expect_err(slip).to_string();
        assert!(refused.starts_with("line 1: write \"# size: VALUE\", a unit behind the value"), "{refused}");
    }
    let vast = parse_csv("s", &format!("# size: 60\n{rows}")).expect_err("too large").to_string();
    assert!(vast.starts_with("line 1: size is 60 m; write \"# size: 60 mm\""), "{vast}");
    let seconds = parse_csv("s", "id,t [ms],x,y\n1,0,0,0\n1,0.04,0.1,0\n").expect_err("too fast").to_string();
    assert!(seconds.starts_with("object 1: moves at 2500 m/s"), "{seconds}");
    assert!(parse_csv("s", &format!("# our table, size = 3\n{rows}")).is_ok());
    let refused = parse_csv("s", &format!("# unit: px\n{rows}")).expect_err("no scale").to_string();
    assert!(refused.starts_with("header, column 3 (x): is in pixels; give the scale"), "{refused}");
}

#[test]
fn cushions_stand_in_a_line_in_front() {
    let rows = "frame,id,x,y\n0,1,100,100\n1,1,120,100\n";
    let scene = parse_csv("s", &format!("# table: 0, 254, 0, 127\n# unit: cm\n{rows}")).expect("it is right");
    assert_eq!(scene.table, Some(Table { x: [0.0, 2.54], y: [0.0, 1.27] }));
    let refused = parse_csv("s", &format!("# cushions: 0 2 0 1\n{rows}")).expect_err("unknown").to_string();
    assert!(refused.starts_with("line 1: cushions is not known; write \"# table: x low"), "{refused}");
    for wrong in ["0 2.54", "0 2.54 0 wide", ""] {
        let refused =
            parse_csv("s", &format!("# table: {wrong}\n{rows}")).expect_err("it is wrong").to_string();
        assert!(refused.contains("give its cushions as x low, x high, y low, y high"), "{refused}");
    }
    let balls = parse_csv("s", &format!("# world: billiards\n{rows}")).expect("it is right");
    assert!(balls.objects[0].shape.is_ball());
    let empty = parse_csv("s", &format!("# table: 2 0 0 1\n{rows}")).expect_err("it is empty").to_string();
    assert!(empty.starts_with("table.x: is from 2 to 0, which is empty"), "{empty}");
}

#[test]
fn everything_wrong_is_reported_with_line_and_column() {
    let check = |text: &str, expected: &[&str]| {
        let found = parse_csv("s", text).expect_err(text).to_string();
        let lines: Vec<&str> = found.lines().collect();
        assert_eq!(lines.len(), expected.len(), "{found}");
        for (line, start) in lines.iter().zip(expected) {
            assert!(line.starts_with(start), "{line} / {start}");
        }
    };
    check(
        "id,t,x,y,shape\n1,0,0,zero,disc\n1.5,0.1,0,0,disc\n1,0.2,,1,disc\n1,0.3,0,0,egg\n1,0.4,0\n1,,1,1,disc\n",
        &[
            "line 2, column 4 (y): is \"zero\"; give a number",
            "line 3, column 1 (id): is 1.5; give a whole number",
            "line 4, column 3 (x): is empty or NaN, but y is not",
            "line 5, column 5 (shape): is \"egg\"; it must be disc, ball or cube",
            "line 6: has 3 columns; the header has 5",
            "line 7, column 2 (t): is empty or NaN; give the time or the frame",
        ],
    );
    // Rows are not judged by what the header lacks.
    let rows: String = (0..200).map(|k| format!("{k},2,3\n")).collect();
    check(&format!("id,x,y\n{rows}"), &["header: has neither a column t nor a column frame; give one"]);
    check(
        "a,b\n",
        &[
            "header: has no column id; it has a, b: rename the one that holds it",
            "header: has no column x",
            "header: has no column y",
            "header: has neither",
        ],
    );
    check("id,t,x,y\n", &["(file): has a header only; give a row"]);
    check(
        "id,t,x [ft],y\n1,0,0,0\n1,1,0,0\n",
        &["header, column 3 (x [ft]): has the unit \"ft\"; known: m, cm, mm"],
    );
    check(
        "# ftp: 50\nid,frame,x,y,massa,vx,coulor,yaww\n1,0,0,0,1,0,red,\n1,1,0,0,1,0,red,\n",
        &[
            "header, column 5 (massa): is not a known column; did you mean mass?",
            "header, column 7 (coulor): is not a known column; did you mean color?",
            "header, column 8 (yaww): is not a known column; did you mean yaw?",
        ],
    );
    check(
        "# scael: 2\nid,frame,x,y\n1,0,0,0\n1,1,0,0\n",
        &["line 1: scael is not known; did you mean scale?"],
    );
    check(
        "id,frame,x,y,yaw\n1,0,0,0,0\n1,1,0,0,45\n",
        &["frame 1, object 1: yaw: is 45, which is not radians"],
    );
    check("# fps: fast\nid,frame,x,y\n1,0,0,0\n1,1,0,0\n", &["line 1: fps is \"fast\""]);
    check(
        "# fps: 25\nid,t,x,y\n1,0,0,0\n1,0.02,0,0\n1,0.04,0,0\n",
        &[
            "fps: is 25, but the times in column t are those of 50 frames a second; correct one of both, or leave out",
        ],
    );
    check(
        "# fps: 50\nid,t,x,y\n1,0,0,0\n1,0.04,0,0\n1,0.08,0,0\n1,0.2,0,0\n",
        &["fps: is 50, but the times in column t are those of 25 frames a second"],
    );
    check("# fsp: 50\nid,frame,x,y\n1,0,0,0\n1,1,0,0\n", &["line 1: fsp is not known; did you mean fps?"]);
    check(
        "id,frame,x,y\n1,0,1e300,0\n1,1,0,0\n",
        &["line 2, column 3 (x): is 1e300 m; it must be within 200 m"],
    );
    // One time has no rate that could contradict.
    assert!(!parse_csv("s", "# fps: 10\nid,t,x,y\n1,0,0,0\n").is_err_and(|e| e.to_string().contains("fps")));
    check("id,frame,x,y\n1,0,0,0\n1,1,0,0\n1,1,0.5,0\n", &["line 4: is the second row of object 1"]);
    check("id,frame,x,y\n1,99999999,0,0\n", &["frame: 99999999 is beyond the 15000 frames"]);
    for empty in ["", "\n \n", "# fps: 25\n"] {
        check(empty, &["(file): has no rows; begin with a header such as `id,t [s],x [mm],y [mm]`"]);
    }
    check("# shape: egg\nid,frame,x,y\n1,0,0,0\n1,1,0,0\n", &["line 1: shape is \"egg\"; it must be disc"]);
}

#[test]
fn the_first_violations_of_a_kind_are_reported_and_the_others_counted() {
    let rows: String = (0..200).map(|k| format!("1,{k},zero,-{k}.5\n")).collect();
    let message = parse_csv("s", &format!("id,frame,x,y\n{rows}")).expect_err("no x").to_string();
    let lines: Vec<&str> = message.lines().collect();
    assert_eq!(lines.len(), 5, "{message}");
    assert!(
        lines[4].starts_with("line 6, column 3 (x)") && lines[4].ends_with("(and 195 more like these)"),
        "{message}"
    );
}

#[test]
fn an_object_has_one_mass_size_shape_material_and_colour() {
    let read =
        |rows: &str| parse_csv("s", &format!("id,frame,x,y,shape,size [mm],mass,material,color\n{rows}"));
    // One of its rows may state it; synonyms of a shape are the same shape.
    let scene = read("1,0,0,0,puck,50,2,metal,red\n1,1,0,0,disc,,,,\n1,2,0,0,,50.0,2.0,Metal,\n")
        .expect("it is right");
    let object = &scene.objects[0];
    assert_eq!((object.shape, object.mass), (Shape::Disc { radius: 0.05 }, Some(2.0)));
    assert_eq!((object.material.as_str(), object.color.as_str()), ("metal", "red"));
    let first = "1,0,0,0,disc,50,2,metal,red\n2,0,3,0,ball,70,3,wood,blue\n";
    for (row, expected) in [
        (
            "1,1,0,0,ball,50,2,metal,red",
            "line 4, column 5 (shape): is \"ball\" where object 1 has \"disc\" in line 2",
        ),
        (
            "1,1,0,0,disc,60,2,metal,red",
            "line 4, column 6 (size [mm]): is \"0.06 m\" where object 1 has \"0.05 m\"",
        ),
        (
            "1,1,0,0,disc,50,3,metal,red",
            "line 4, column 7 (mass): is \"3 kg\" where object 1 has \"2 kg\" in line 2",
        ),
        (
            "2,1,3,0,ball,70,3,metal,blue",
            "line 4, column 8 (material): is \"metal\" where object 2 has \"wood\"",
        ),
        (
            "2,1,3,0,ball,70,3,wood,red",
            "line 4, column 9 (color): is \"red\" where object 2 has \"blue\" in line 3",
        ),
        ("1,1,0,0,disc,50,-2,metal,red", "line 4, column 7 (mass): is -2 kg; it must be from 1e-9 to"),
        ("1,1,0,0,disc,0,2,metal,red", "line 4, column 6 (size [mm]): is 0 m; it must be from 1e-6 to"),
    ] {
        let message = read(&format!("{first}{row}\n")).expect_err(row).to_string();
        assert!(message.starts_with(expected) && message.lines().count() == 1, "{message} / {expected}");
    }
}

#[test]
fn rows_may_be_in_any_order_but_one_for_each_object_and_time() {
    let rows = ["1,0,0,0", "1,0.1,0.1,0", "2,0,3,0", "1,0.2,0.2,0", "2,0.1,3,0.1"];
    let read = |rows: &[&str]| parse_csv("s", &format!("id,t,x,y\n{}\n", rows.join("\n")));
    let known = read(&rows).expect("it is right");
    let mut mixed = [rows[1], rows[4], rows[3], rows[0], rows[2]];
    assert_eq!(read(&mixed).expect("it is right"), known);
    mixed[4] = "1,0.2,0.5,0";
    let message = read(&mixed).expect_err("twice").to_string();
    assert!(
        message.starts_with("line 6: is the second row of object 1 at this time, after line 4; keep one"),
        "{message}"
    );
}

#[test]
fn numbers_too_large_for_metres_are_reported_with_the_unit_to_give() {
    let text = |unit: &str| format!("id,t,x{unit},y\n1,0,-197.54,0\n1,0.04,1067.45,0\n1,0.08,2067.45,0\n");
    let message = parse_csv("s", &text(" [m]")).expect_err("no table is so large").to_string();
    let start = "line 3, column 3 (x [m]): is 1067.45 m; it must be within 200 m";
    assert!(message.starts_with(start) && message.contains("`x [mm]`"), "{message}");
    assert!(!message.contains("line 2"), "{message}");
    // Without a unit they are pixels, or millimetres.
    let (scene, assumed) = read_table("s", &text(""), &TableDefaults::default()).expect("pixels");
    assert_eq!(scene.tracks[0].samples[1].position.x, 1.06745);
    assert!(
        assumed.iter().any(|line| line.contains("too large for metres, taken as pixels of 1 mm")),
        "{assumed:?}"
    );
    // One number of many is an error, or a sign for "not seen".
    let rows: String =
        (0..40).map(|k| format!("1,{k},{},0\n", if k == 7 { 999.0 } else { 0.1 * f64::from(k) })).collect();
    let message = parse_csv("s", &format!("id,frame,x,y\n{rows}")).expect_err("999 m").to_string();
    assert!(message.starts_with("line 9, column 3 (x): is 999 m"), "{message}");
    assert!(parse_csv("s", &text(" [mm]")).is_ok());
}

proptest! {
    #[test]
    fn no_text_panics(text in "(id,t,x,y\n)?[0-9a-z,;#:. \"\n-]{0,80}", any in ".{0,60}") {
        let _ = parse_csv("s", &text);
        let _ = parse_csv("s", &any);
    }
}

#[test]
fn what_a_file_does_not_state_is_listed_with_what_to_write() {
    let assumed = |text: &str| read_table("s", text, &TableDefaults::default()).expect(text).1;
    let bare = "id,frame,x,y\n1,0,0,0\n1,1,100,0\n1,2,130,0\n";
    insta::assert_snapshot!(assumed(bare).join("\n"), @r"
    radius or half side of 0.2 m (`# size: 30 mm`)
    25 frames per second (`# fps: 50`)
    world table, which selects the preset (`# world: air_table`)
    masses near 1 kg, as none is given: masses and forces (N) are relative (a column `mass [kg]`)
    metres, although the tracks span 130 m for objects of 0.2 m: is the unit cm? (`# unit: cm`)
    ");
    let close = "id,frame,x,y\n1,0,0,0\n1,1,0.01,0\n2,0,0.37,0\n2,1,0.37,0\n";
    assert!(
        assumed(close).last().is_some_and(|line| line.contains("size and unit right")),
        "{:?}",
        assumed(close)
    );
    let whole = "# world: table\nid,t,x,y,mass,size\n1,0,0,0,1,0.03\n1,0.04,0.5,0,,\n1,0.08,0.8,0,,\n";
    assert_eq!(assumed(whole), [""; 0]);
}

/// Position of the only object in each frame, and what was taken.
fn taken(text: &str) -> (Vec<[f64; 2]>, String) {
    let (scene, assumed) =
        read_table("s", text, &TableDefaults::default()).unwrap_or_else(|e| panic!("{text}\n{e}"));
    let samples = scene.tracks[0].samples.iter().map(|s| [s.position.x, s.position.y]);
    (samples.collect(), assumed.join("\n"))
}

#[test]
fn thousands_are_read_where_they_are_certain_and_asked_for_where_not() {
    let expected = vec![[0.9985, 0.2], [1.0015, 0.201], [1.234, 0.203]];
    for rows in [
        "id;frame;x [mm];y [mm]\n1;0;998,5;200\n1;1;1.001,5;201\n1;2;1 234,0;203\n",
        "id;frame;x [mm];y [mm]\n1;0;998.5;200\n1;1;1,001.5;201\n1;2;1,234;203\n",
        "id,frame,x [mm],y [mm]\n1,0,998.5,200\n1,1,\"1,001.5\",201\n1,2,\"1,234\",203\n",
        "id\tframe\tx [mm]\ty [mm]\n1\t0\t998,5\t200\n1\t1\t1'001,5\t201\n1\t2\t1234\t203\n",
    ] {
        assert_eq!(taken(rows).0, expected, "{rows}");
    }
    for (rows, start) in [
        (
            "id;frame;x [mm];y [mm]\n1;0;987;1\n1;1;1.001;1\n",
            "line 3, column 3 (x [mm]): is \"1.001\" beside 987: `.` may separate",
        ),
        (
            "id;frame;x [mm];y [mm]\n1;0;2,987;1\n1;1;1,001;1\n",
            "line 2, column 3 (x [mm]): is \"2,987\": `,` may separate",
        ),
        (
            "id;frame;x [mm];y [mm]\n1;0;987,5;1\n1;1;1.001;1\n",
            "line 3, column 3 (x [mm]): is \"1.001\" in a table with decimal commas",
        ),
    ] {
        let message = parse_csv("s", rows).expect_err(rows).to_string();
        assert!(
            message.starts_with(start) && message.contains("write numbers without separators of thousands"),
            "{message}"
        );
    }
    // Three decimals are no thousands.
    assert_eq!(taken("id;frame;x;y\n1;0;1,250;0,125\n1;1;1,375;0,250\n").0, [[1.25, 0.125], [1.375, 0.25]]);
    assert_eq!(taken("id,frame,x,y\n1,0,1.250,5\n1,1,1.375,5\n").0, [[1.25, 5.0], [1.375, 5.0]]);
}

#[test]
fn what_is_no_row_is_left_out_with_words() {
    let rows = "id,frame,x,y\n0,0,0.25,0.31\n0,1,0.25,0.33\n0,2,0.25,0.35\n";
    let known = vec![[0.25, 0.31], [0.25, 0.33], [0.25, 0.35]];
    for (text, part) in [
        (
            rows.replace("0.33\n", "0.33 # lost, nearly\n"),
            "comments behind rows are left out (1, the first in line 3: \"lost nearly\")",
        ),
        (format!("{rows}Total rows: 3\n"), "line 5 (\"Total rows: 3\") is no row"),
        (format!("{rows}-----\nmean,,0.25,0.33\n"), "line 6 (\"mean 0.25 0.33\") is no row"),
        (format!("{rows}0,3,0.2"), "the last line (5: \"0 3 0.2\") is cut"),
        (format!("{rows}0,3,0.25,0.3"), "the last line (5: \"0 3 0.25 0.3\") is cut"),
    ] {
        let (found, words) = taken(&text);
        assert!(found == known && words.contains(part), "{text}\n{words}");
    }
    let named: String = (0..20).map(|k| format!("max,{k},0.5,0.5\n")).collect();
    assert_eq!(taken(&format!("id,frame,x,y\n{named}")).0.len(), 20);
    assert_eq!(taken("x,y,frame,id\n1,1,0,#1\n1,1,1,#1\n").0.len(), 2);
    // Nothing is cut off a file that only lacks the last line's end, and an id keeps its sign.
    assert_eq!(taken(rows.trim_end()).0, known);
    assert_eq!(taken("x,y,frame,id\n1,1,0,ball #1\n1,1,1,ball #1\n").0.len(), 2);
}

#[test]
fn boxes_give_their_middle() {
    let known = vec![[0.020, 0.035], [0.022, 0.035], [0.025, 0.036]];
    for (text, part) in [
        (
            "frame,id,x1 [px],y1 [px],x2 [px],y2 [px]\n0,1,10,20,30,50\n1,1,12,20,32,50\n2,1,15,21,35,51\n",
            "boxes `x1 [px], y1 [px], x2 [px], y2 [px]`",
        ),
        (
            "frame,left [px],top [px],width,height\n0,10,20,20,30\n1,12,20,20,30\n2,15,21,20,30\n",
            "boxes `left [px], top [px], width, height`",
        ),
        (
            "frame,x [px],y [px],w,h\n0,10,20,20,30\n1,12,20,20,30\n2,15,21,20,30\n",
            "boxes `x [px], y [px], w, h`",
        ),
    ] {
        let (found, words) = taken(text);
        let near =
            found.iter().zip(&known).all(|(a, b)| (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
        assert!(
            near && words.contains(part) && words.contains("pixels, taken as 1 mm each"),
            "{found:?}\n{words}"
        );
    }
    // Without an id they are two objects.
    assert_eq!(parse_csv("s", "frame,x1,y1,x2,y2\n0,0,0,2,2\n1,0,0,2,2\n").expect("two").objects.len(), 2);
}

#[test]
fn a_table_without_a_header_is_read_where_it_can_mean_one_thing() {
    assert_eq!(taken("0 0.5 0.25\n0.04 0.5 0.30\n0.08 0.5 0.40\n").0, [[0.5, 0.25], [0.5, 0.3], [0.5, 0.4]]);
    let mot = "1,1,912,484,97,109,0,7,1\n1,2,700,300,50,60,1,1,1\n2,1,914,484,97,109,0,7,1\n2,2,700,300,50,60,1,1,1\n";
    let (found, words) = taken(mot);
    assert_eq!(found, [[0.9605, 0.5385], [0.9625, 0.5385]]);
    assert!(
        words.contains("no header: the columns are taken as frame, id, left, top, width, height"),
        "{words}"
    );
    let long = "1,1,0.5,0.25\n1,2,1.5,0.25\n2,1,0.5,0.35\n2,2,1.5,0.25\n3,1,0.5,0.45\n3,2,1.5,0.25\n";
    assert_eq!(taken(long).0, [[0.5, 0.25], [0.5, 0.35], [0.5, 0.45]]);
    for (text, part) in [
        (
            "0,0,1,1523.65,334.641,1\n1,0,1,1523.79,334.308,1\n2,0,1,1523.45,334.643,1\n",
            "its 6 columns may hold several things",
        ),
        ("0.03,-1.14\n0.06,-1.15\n0.09,-1.20\n", "a time and one coordinate"),
        (
            "1,-1,281,187,79,209,0.9\n1,-1,56,144,93,295,0.9\n2,-1,56,144,93,295,0.9\n",
            "its boxes have no ids (-1)",
        ),
    ] {
        let message = parse_csv("s", text).expect_err(text).to_string();
        assert!(
            message.contains(part) && message.contains("put a line in front that names the columns"),
            "{message}"
        );
    }
}

#[test]
fn of_three_coordinates_those_that_move_most_are_the_plane() {
    let rows = |flat: [&str; 3]| {
        format!(
            "frame,x,y,z\n0,{},{},{}\n1,{},{},{}\n",
            flat[0],
            flat[1],
            flat[2],
            1.5,
            if flat[1] == "0.1" { "0.1" } else { "3" },
            if flat[2] == "0.1" { "0.1" } else { "3" }
        )
    };
    let (found, words) = taken(&rows(["1", "2", "0.1"]));
    assert!(found == [[1.0, 2.0], [1.5, 3.0]] && !words.contains("x and z"), "{words}");
    let (found, words) = taken(&rows(["1", "0.1", "2"]));
    assert!(
        found == [[1.0, 2.0], [1.5, 3.0]] && words.contains("x and z of three coordinates, which move most"),
        "{words}"
    );
}

#[test]
fn a_column_with_a_z_in_its_name_is_no_coordinate() {
    let (found, words) = taken("frame,x,y,z_score\n0,1,2,0\n1,1.5,2.1,9\n");
    assert!(found == [[1.0, 2.0], [1.5, 2.1]] && !words.contains("three coordinates"), "{words}");
}

#[test]
fn a_radius_that_is_measured_in_each_row_is_no_constant() {
    let rows: String = (0..9).map(|k| format!("{k},0.5,0.{k},{}\n", 12 + k % 6)).collect();
    let (scene, assumed) =
        read_table("s", &format!("frame,x,y,radius [mm]\n{rows}"), &TableDefaults::default())
            .expect("radius");
    assert_eq!(scene.objects[0].shape, Shape::Disc { radius: 0.014 });
    assert!(assumed.iter().any(|line| line.contains("the median of `radius [mm]`")), "{assumed:?}");
}

#[test]
fn an_id_that_counts_rows_is_refused() {
    let rows: String = (0..20).map(|k| format!("{k},{},0.5,0.5\n", k / 2)).collect();
    let message = parse_csv("s", &format!("id,frame,x,y\n{rows}")).expect_err("counts").to_string();
    assert!(message.starts_with("header, column 1 (id): has another id in each of 20 rows"), "{message}");
    let unnamed = parse_csv("s", "frame,x,y\n0,1,1\n0,2,2\n1,1,1\n").expect_err("no id").to_string();
    assert!(
        unnamed.starts_with("line 3: is the second position at this time, after line 2, and no column"),
        "{unnamed}"
    );
}
