//! One video in the dialects of spreadsheets and trackers: all give the same scene, and say how they were read.

use super::*;
use crate::scene::{Scene, SceneError};
use proptest::prelude::*;

fn read(text: &str) -> Result<SceneFile, SceneError> {
    read_scene("s", text.as_bytes(), &TableDefaults::default())
}

/// The id of an object, and its positions (mm) by frame.
type ObjectPath = (u32, Vec<(usize, [i64; 2])>);

/// Positions by object and frame, in mm.
fn positions(scene: &Scene) -> Vec<ObjectPath> {
    let mm = |v: f64| (1e3 * v).round() as i64;
    let of = |(o, t): (&crate::scene::Object, &crate::scene::Track)| {
        (o.id, t.samples.iter().map(|s| (s.frame, [mm(s.position.x), mm(s.position.y)])).collect())
    };
    scene.objects.iter().zip(&scene.tracks).map(of).collect()
}

/// Two objects in three frames of 20 ms; the second is not seen in the second frame.
fn known(first: u32) -> Vec<ObjectPath> {
    vec![
        (first, vec![(0, [0, 0]), (1, [10, 0]), (2, [20, 0])]),
        (first + 1, vec![(0, [500, 500]), (2, [500, 500])]),
    ]
}

#[test]
fn one_video_in_many_dialects_is_the_same_scene() {
    let comma = "id,t,x,y\n0,0,0,0\n1,0,0.5,0.5\n0,0.02,0.01,0\n1,0.02,,\n0,0.04,0.02,0\n1,0.04,0.5,0.5\n";
    let decimal = "id;t;x;y\n0;0;0;0\n1;0;0,5;0,5\n0;0,02;0,01;0\n1;0,02;;\n0;0,04;0,02;0\n1;0,04;0,5;0,5\n";
    let absent = |word: &str| comma.replace("0.02,,", &format!("0.02,{word},{word}"));
    let wide = "t,a_x,a_y,b_x,b_y\n0,0,0,0.5,0.5\n0.02,0.01,0,,\n0.04,0.02,0,0.5,0.5\n";
    for (text, first) in [
        (comma.to_string(), 0),
        (comma.replace(',', "\t"), 0),
        (comma.replace(',', "|"), 0),
        (comma.replace(",,", ",NA,NA").replace(',', "  "), 0),
        (decimal.to_string(), 0),
        (format!("sep=;\n{decimal}"), 0),
        (format!("\u{feff}{comma}").replace('\n', "\r\n"), 0),
        (comma.replace('\n', "\r"), 0),
        (absent("NA"), 0),
        (absent("None"), 0),
        (absent("null"), 0),
        (absent("#N/A"), 0),
        (absent("--"), 0),
        (comma.replace("id", "particle").replace("t,", "seconds,"), 0),
        (comma.replace("id,t,x,y", "\"puck\",\"time (s)\",\"pos_x\",\"pos_y\""), 0),
        (comma.replace("\n0,", "\nred,").replace("\n1,", "\nwhite,"), 0),
        (comma.replace("\n1,", "\npuck 2,").replace("\n0,", "\npuck 1,"), 1),
        (comma.replace("id,t,x,y\n", "id,t,x,y\n,s,m,m\n"), 0),
        (comma.replace("id,t,x,y", "# id,t,x,y"), 0),
        (wide.to_string(), 0),
        (wide.replace("a_x,a_y,b_x,b_y", "x1,y1,x2,y2"), 1),
        (wide.replace("a_x,a_y,b_x,b_y", "x_1,y_1,x_2,y_2"), 1),
        (wide.replace("a_x,a_y,b_x,b_y", "Ax,Ay,Bx,By"), 0),
        (wide.replace("a_x,a_y,b_x,b_y", "x,y,x,y"), 0),
        (wide.replace("t,a_x,a_y,b_x,b_y", ",A,,B,\nt,x,y,x,y"), 0),
        (wide.replace("t,a_x,a_y,b_x,b_y", "#multi:\n,mass A,,mass B,\nt,x,y,x,y"), 0),
        (comma.replace("\n0,", "\n0,0,").replace("\n1,", "\n1,1,"), 0),
    ] {
        let found = read(&text).unwrap_or_else(|e| panic!("{text}\n{e}"));
        assert_eq!(positions(&found.scene), known(first), "{text}");
        assert_eq!(found.scene.times, [0.0, 0.02, 0.04], "{text}");
    }
}

#[test]
fn what_was_taken_is_said() {
    let says = |text: &str, part: &str| {
        let assumed = read(text).unwrap_or_else(|e| panic!("{text}\n{e}")).assumed;
        assert!(assumed.iter().any(|line| line.contains(part)), "{part}: {assumed:?}");
    };
    says(
        "puck;t;x;y\n0;0;0,5;0\n0;0,02;0,51;0\n",
        "semicolons, decimal commas, column `puck` as id, 50 frames/s from the times",
    );
    says("t,x,y\n0,0,0\n1,1,1\n", "one object, with id 0 (a column `id`)");
    says("x,y\n0,0\n1,1\n", "one row for each frame (a column `frame` or `t [s]`)");
    says("id,t,x,y\nB,0,0,0\nA,0,3,0\nB,1,0,0\nA,1,3,0\n", "0 is A, 1 is B");
    says(
        "t,x,y\n1771234567.25,0,0\n1771234567.27,1,1\n",
        "times counted from the first one on, 1771234567.25 s",
    );
    says("t,x,y\n1771234567250,0,0\n1771234567270,1,1\n", "1771234567250 milliseconds");
    says("t,x,y\n-2,0,0\n-1,1,1\n", "times counted from the first one on, -2 s");
    says(
        "t,x,y\n2024-05-01 10:00:00.00,0,0\n2024-05-01 10:00:00.04,1,1\n",
        "times counted from the first one on",
    );
    says("frame,x,y\n20000,0,0\n20001,1,1\n", "frames counted from 20000 on");
    says("frame,x,y\n0,0,0\n1,1,1\n", "25 frames per second");
    says(
        "t,a_x,a_y,b_x,b_y\n0,0,0,0.1,0\n1,0,0,0.06,0\n",
        "radius or half side of 3.00e-2 m, half of the least distance",
    );
    says("id,t,x,y\n1,0,0,0\n1,0,0,0\n1,1,0,1\n", "one row in place of several equal ones (1 rows");
    says("t,x,y,likelihood\n0,0,0,0.9\n1,9,9,0.1\n2,1,1,1\n", "1 positions with a likelihood below 0.6");
}

#[test]
fn times_of_a_calendar_are_those_of_the_video() {
    let scene =
        read("t,x,y\n1771234567.250,0,0\n1771234567.270,0.1,0\n1771234567.290,0.2,0\n").unwrap().scene;
    assert_eq!(scene.times, [0.0, 0.02, 0.04]);
    let scene = read("t,x,y\n-0.02,0,0\n0,0.1,0\n0.02,0.2,0\n").unwrap().scene;
    assert_eq!(scene.times, [0.0, 0.02, 0.04]);
}

#[test]
fn tables_of_trackers_are_read() {
    let deeplabcut = "scorer,net,net,net,net,net,net\nbodyparts,a,a,a,b,b,b\ncoords,x,y,likelihood,x,y,likelihood\n\
                      0,0,0,1,500,500,1\n1,10,0,1,7,7,0.01\n2,20,0,1,500,500,0.99\n";
    let sleap = "track,frame_idx,instance.score,p.x,p.y,p.score\nt0,0,0.9,0,0,0.9\nt1,0,0.9,500,500,0.9\nt0,1,0.9,10,0,0.9\n\
                 t0,2,0.9,20,0,0.9\nt1,2,0.9,500,500,0.9\n";
    let idtracker = "seconds,x1,y1,x2,y2\n0.000,0.000,0.000,500.000,500.000\n0.020,10.000,0.000,nan,nan\n0.040,20.000,0.000,500.000,500.000\n";
    let trackpy = ",y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle\n0,0,0,9.1,2.1,0.1,5,99,0.1,0,0\n1,500,500,9.2,2.2,0.1,5,98,0.1,0,1\n\
                   2,0,10,9.3,2.3,0.1,5,97,0.1,1,0\n3,0,20,9.4,2.4,0.1,5,96,0.1,2,0\n4,500,500,9.5,2.5,0.1,5,95,0.1,2,1\n";
    let trex = "frame,time,X#wcentroid (cm),Y#wcentroid (cm),SPEED (cm/s),missing\n0,0,0,0,3,0\n1,0.02,inf,inf,inf,1\n2,0.04,2,0,3,0\n";
    for (text, first) in [(deeplabcut, 0), (sleap, 0), (idtracker, 1), (trackpy, 0)] {
        let refused = read(&format!("# unit: px\n{text}")).unwrap_err().to_string();
        assert!(refused.contains("give the scale in a line `# scale: 0.002`"), "{refused}");
        let scene = read(&format!("# scale: 0.001\n# fps: 50\n{text}"))
            .unwrap_or_else(|e| panic!("{text}\n{e}"))
            .scene;
        assert_eq!((positions(&scene), scene.objects[0].mass), (known(first), None), "{text}");
    }
    for text in [deeplabcut, sleap, trackpy] {
        let found = read(&format!("# fps: 50\n{text}")).unwrap_or_else(|e| panic!("{text}\n{e}"));
        assert_eq!(positions(&found.scene), known(0), "{text}");
        assert!(
            found.assumed.iter().any(|line| line.contains("pixels, taken as 1 mm each")),
            "{:?}",
            found.assumed
        );
    }
    let trackmate = "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_T,FRAME\nLabel,Spot ID,Track ID,Quality,X,Y,T,Frame\n\
                     Label,Spot ID,Track ID,Quality,X,Y,T,Frame\n,,,(quality),(micron),(micron),(sec),\nID7,7,0,9.5,0,0,0,0\n\
                     ID8,8,0,9.5,10000,0,0.02,1\nID9,9,1,9.5,500000,500000,0,0\n";
    let found = read(trackmate).unwrap();
    assert_eq!(positions(&found.scene), [(0, vec![(0, [0, 0]), (1, [10, 0])]), (1, vec![(0, [500, 500])])]);
    assert!(found.assumed.iter().any(|line| line.contains("column `TRACK_ID` as id")), "{:?}", found.assumed);
    let scene = read(trex).unwrap().scene;
    assert_eq!(positions(&scene), [(0, vec![(0, [0, 0]), (2, [20, 0])])]);
}

#[test]
fn text_of_tracker_is_read() {
    let one = "mass A\t\t\nt\tx\ty\n0,0\t1,0\t2,0\n0,1\t\t\n0,2\t1,2\t2,5\n";
    let scene = read(one).unwrap().scene;
    assert_eq!(positions(&scene), [(0, vec![(0, [1000, 2000]), (2, [1200, 2500])])]);
    let own = "A,,,B,,\nt,x,y,t,x,y\n0,0,0,0.1,2,2\n0.1,0.1,0,0.2,2,2\n0.2,0.2,0\n";
    let scene = read(own).unwrap().scene;
    assert_eq!(positions(&scene)[1], (1, vec![(1, [2000, 2000]), (2, [2000, 2000])]));
    let wrong = read("t\tx\ty\n0\tq\t1\n1\t1\t1\n").unwrap_err();
    assert_eq!(wrong.violations[0].path, "line 2, column 2 (x)");
}

#[test]
fn a_refusal_says_what_to_write() {
    let check = |text: &str, expected: &str| {
        let message = read(text).map(|f| f.assumed).expect_err(text).to_string();
        assert!(message.starts_with(expected), "{message}");
    };
    check(
        "0,0.1,0.2\n1,0.2,0.3\n",
        "header: is missing, and its lines do not tell what they hold; put a line in front that names the columns, such as `id,t",
    );
    check(
        "t,x,y\n0,04,1,5,2,5\n0,08,1,6,2,6\n",
        "line 2: has 6 columns; the header has 3; give the same number; if commas are decimal",
    );
    check("t,x\n0,1\n1,2\n", "header: has no column id");
    check("<gpx/>", "(file): is XML, but no project of Tracker");
}

#[test]
fn a_rounded_rate_is_no_contradiction() {
    assert!(read("# fps: 30\nid,t,x,y\n1,0,0,0\n1,0.033367,0,0\n1,0.066733,0,0\n").is_ok());
    let refused = read("# fps: 30\nid,t,x,y\n1,0,0,0\n1,0.034,0,0\n1,0.068,0,0\n").unwrap_err().to_string();
    assert!(refused.starts_with("fps: is 30, but the times"), "{refused}");
}

#[test]
fn a_written_table_reads_back_equal() {
    for text in [
        include_str!("../../../tests/data/csv/video_1.csv"),
        "# table: 0 2 0 1\n# setup: lab 1\n# world: air_table\nid,frame,x,y,yaw,mass,color\n3,0,0.1,0.5,0.1,1.5,red\n3,1,,,,,\n3,2,0.3,0.5,,,\n5,2,1.3,0.5,,,\n",
    ] {
        let scene = read(text).unwrap().scene;
        let written = written_csv(&scene).unwrap();
        assert_eq!(read(&written).unwrap().scene, scene, "{written}");
        assert_eq!(written_csv(&read(&written).unwrap().scene).unwrap(), written);
    }
}

proptest! {
    #[test]
    fn no_bytes_panic(
        bytes in prop::collection::vec(any::<u8>(), 0..120),
        rows in "(#|%)?(t|frame|time|,){1,3}(x|y|A_x|x1|,|;|\t| ){0,9}\n[0-9.,;\t |:eNAx-]{0,60}\n[0-9,;\t -]{0,30}",
        zip in prop::collection::vec(any::<u8>(), 0..80),
    ) {
        let defaults = TableDefaults::default();
        let _ = read_scene("s", &bytes, &defaults);
        let _ = read_scene("s", rows.as_bytes(), &defaults);
        let _ = read_scene("s", &[b"PK\x03\x04", &zip[..], b".trkPK\x05\x06", &zip[..]].concat(), &defaults);
    }
}
