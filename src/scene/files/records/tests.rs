//! Files of records, each with what it gives and what is said of it.

use crate::scene::files::{SceneFile, TableDefaults, read_scene};
use crate::scene::{Scene, SceneError};

fn read(bytes: &[u8]) -> Result<SceneFile, SceneError> {
    read_scene("s", bytes, &TableDefaults::default())
}

/// Id of each object with its samples: frame, x and y (mm).
type Paths = Vec<(u32, Vec<(usize, i64, i64)>)>;

/// Id, and positions in mm by frame, of each object.
fn paths(scene: &Scene) -> Paths {
    let mm = |v: f64| (1e3 * v).round() as i64;
    let of = |(o, t): (&crate::scene::Object, &crate::scene::Track)| {
        (o.id, t.samples.iter().map(|s| (s.frame, mm(s.position.x), mm(s.position.y))).collect())
    };
    scene.objects.iter().zip(&scene.tracks).map(of).collect()
}

/// One object on a line in three frames.
fn known(id: u32) -> Paths {
    vec![(id, vec![(0, 100, 400), (1, 120, 400), (2, 150, 410)])]
}

#[test]
fn logs_and_json_give_the_tracks_and_say_how() {
    for (text, id, part) in [
        (
            "[12:00:00.00] id=3 x=0.1 y=0.4\n[12:00:00.04] id=3 x=0.12 y=0.4\nlost\n[12:00:00.08] id=3 x=0.15 y=0.41\n",
            3,
            "1 lines without positions are left out (the first is line 3: \"lost\")",
        ),
        (
            "frame 0: (x, y) = (0.1, 0.4)\nframe 1: (x, y) = (0.12, 0.4)\nframe 2: (x, y) = (0.15, 0.41)\n",
            0,
            "lines of a log with frame, x, y",
        ),
        (
            "t=0s x=10cm y=40cm\nt=0.04s x=12cm y=40cm\nt=0.08s x=15cm y=41cm\n",
            0,
            "lines of a log with t, x, y",
        ),
        (
            "{\"frame\":0,\"id\":1,\"x\":0.1,\"y\":0.4}\n{\"frame\":1,\"id\":1,\"x\":0.12,\"y\":0.4}\n{\"frame\":2,\"id\":1,\"x\":0.15,\"y\":0.41}\n{\"frame\":3,\"id\"",
            1,
            "the last line (4) is cut",
        ),
        (
            "[{\"t\":0,\"pos\":[0.1,0.4]},{\"t\":0.04,\"pos\":[0.12,0.4]},{\"t\":0.08,\"pos\":[0.15,0.41]}]",
            0,
            "3 records of JSON",
        ),
        (
            "{\"width\":1920,\"height\":1080,\"frames\":[{\"objects\":[{\"id\":1,\"x\":0.1,\"y\":0.4}]},{\"objects\":[{\"id\":1,\"x\":0.12,\"y\":0.4}]},{\"objects\":[{\"id\":1,\"x\":0.15,\"y\":0.41}]}]}",
            1,
            "3 records of JSON",
        ),
        (
            "{\"tracks\":{\"7\":[{\"frame\":0,\"x\":0.1,\"y\":0.4},{\"frame\":1,\"x\":0.12,\"y\":0.4},{\"frame\":2,\"x\":0.15,\"y\":0.41}]}}",
            7,
            "3 records of JSON",
        ),
        (
            "{\"images\":[{\"id\":0,\"file_name\":\"a.png\"}],\"annotations\":[{\"id\":8,\"image_id\":0,\"track_id\":2,\"bbox\":[90,390,20,20]},{\"id\":9,\"image_id\":1,\"track_id\":2,\"bbox\":[110,390,20,20]},{\"id\":10,\"image_id\":2,\"track_id\":2,\"bbox\":[140,400,20,20]}]}",
            2,
            "1 records without positions",
        ),
        (
            "{\"trajectories\":[[[100,400]],[[120,400]],[[150,410]]],\"frames_per_second\":25}",
            1,
            "pixels, taken as 1 mm each",
        ),
    ] {
        let found = read(text.as_bytes()).unwrap_or_else(|e| panic!("{text}\n{e}"));
        assert_eq!(paths(&found.scene), known(id), "{text}");
        assert!(found.assumed.iter().any(|line| line.contains(part)), "{part}: {:?}", found.assumed);
    }
}

#[test]
fn xml_and_files_of_trackers_give_the_tracks() {
    let spot = |id: u32, frame: u32, x: u32, y: u32| {
        format!("<Spot ID='{id}' FRAME='{frame}' POSITION_X='{x}' POSITION_Y='{y}'/>")
    };
    let spots = [spot(5, 0, 100, 400), spot(6, 1, 120, 400), spot(7, 2, 150, 410), spot(8, 0, 9, 9)].concat();
    let model = format!(
        "<TrackMate><Model spatialunits='pixel'><AllSpots>{spots}</AllSpots><AllTracks><Track><Edge SPOT_SOURCE_ID='6' SPOT_TARGET_ID='7'/>\
         <Edge SPOT_SOURCE_ID='5' SPOT_TARGET_ID='6'/></Track></AllTracks></Model></TrackMate>"
    );
    let motive = "Format Version,1.23,Length Units,Centimeters\n\n,,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker\n\
                  ,,puck 1,puck 1,puck 1,puck 1,puck 1,puck 1,puck 1:a,puck 1:a,puck 1:a\n,,A,A,A,A,A,A,B,B,B\n\
                  ,,Rotation,Rotation,Rotation,Position,Position,Position,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,X,Y,Z,X,Y,Z\n\
                  0,0.00,0,0,0,10,2,40,1,2,3\n1,0.04,0,1,0,12,2,40,1,2,3\n2,0.08,0,2,0,15,2,41,1,2,3\n";
    for (text, id) in [
        (
            "<Tracks spaceUnits='pixel'><particle><detection t='0' x='100' y='400'/><detection t='1' x='120' y='400'/><detection t='2' x='150' y='410'/></particle></Tracks>",
            0,
        ),
        (
            "<annotations><track id='4'><box frame='0' outside='0' xtl='90' ytl='390' xbr='110' ybr='410'/><box frame='1' outside='0' xtl='110' ytl='390' xbr='130' ybr='410'/><box frame='2' outside='0' xtl='140' ytl='400' xbr='160' ybr='420'/></track></annotations>",
            4,
        ),
        (model.as_str(), 0),
        (
            "MTrackJ 1.5.1 Data File\nTrack 1\nPoint 1 100 400 1.0 0.0 1.0\nPoint 2 120 400 1.0 1.0 1.0\nPoint 3 150 410 1.0 2.0 1.0\n",
            1,
        ),
        (
            "Trajectories\n25\n,,a,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n0,0,100,400,5\n1,0,120,400,5\n2,0,150,410,5\n",
            0,
        ),
        (
            "comment,\"OptiTrack\"\ninfo,version,1.1\nframe,0,0.00,1,1,0.1,0.4,0.7,0,0,0,1,0,0,0,0\nframe,1,0.04,1,1,0.12,0.4,0.7,0,0,0,1,0,0,0,0\nframe,2,0.08,1,1,0.15,0.41,0.7,0,0,0,1,0,0,0,0\n",
            1,
        ),
        (motive, 1),
    ] {
        let found = read(text.as_bytes()).unwrap_or_else(|e| panic!("{text}\n{e}"));
        assert_eq!(paths(&found.scene), known(id), "{text}");
    }
}

#[test]
fn what_may_be_read_in_two_ways_is_refused() {
    for (text, part) in [
        ("x=0,12 y=0,4\nx=0,13 y=0,4\n", "header: "),
        ("t=0 x=1cm y=1cm\nt=1 x=1mm y=1cm\n", "line 2: has x in mm, lines before it in cm; write one unit"),
        ("[{\"a\":1},{\"a\":2}]", "(file): has 2 records without positions, with a; name the fields"),
        ("{\"x\":1}\n{\"x\":2}\nnot\n{}\n", "line 3: is not JSON"),
        ("{\"a\": [1, 2]}", "(file): is JSON without tracks that are known"),
    ] {
        let message = read(text.as_bytes()).map(|found| found.assumed).expect_err(text).to_string();
        assert!(message.starts_with(part), "{message}");
    }
}

/// A file of NumPy with one array.
fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
}

/// A zip archive with these files, not compressed.
fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut all, mut directory) = (vec![], vec![]);
    for (name, content) in files {
        let size = (content.len() as u32).to_le_bytes();
        let length = (name.len() as u16).to_le_bytes();
        let at = (all.len() as u32).to_le_bytes();
        all.extend(
            [
                b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0",
                &size[..],
                &size,
                &length,
                &[0, 0],
                name.as_bytes(),
                content,
            ]
            .concat(),
        );
        directory.extend(
            [
                b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0\0\0\0\0",
                &size[..],
                &size,
                &length,
                &[0; 12],
                &at,
                name.as_bytes(),
            ]
            .concat(),
        );
    }
    let at = (all.len() as u32).to_le_bytes();
    [all, directory, [b"PK\x05\x06\0\0\0\0\x01\0\x01\0\0\0\0\0", &at[..], &[0, 0]].concat()].concat()
}

#[test]
fn workbooks_and_arrays_are_tables() {
    let rows = [[0.0, 0.1, 0.4], [0.04, 0.12, 0.4], [0.08, 0.15, 0.41]];
    let bytes = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let column = |at: usize| npy("'<f8'", "(3,)", &bytes(&rows.map(|row| row[at])));
    let fields = "[('t', '<f8'), ('x', '<f8'), ('y', '<f8')]";
    let sheet = "<worksheet><sheetData><row><c r='A1' t='s'><v>0</v></c><c r='B1' t='inlineStr'><is><t>x [cm]</t></is></c><c r='C1' t='s'><v>1</v></c></row>\
                 <row><c r='A2'><v>0</v></c><c r='B2'><v>10</v></c><c r='C2'><v>0.4</v></c></row><row><c r='A3'><v>0.04</v></c><c r='B3'><v>12</v></c><c r='C3'><v>0.4</v></c></row>\
                 <row><c r='A4'><v>0.08</v></c><c r='B4'><v>15</v></c><c r='C4'><v>0.41</v></c></row></sheetData></worksheet>";
    let strings = "<sst><si><t>t</t></si><si><r><t>y</t></r></si></sst>";
    let workbook =
        zip(&[("xl/sharedStrings.xml", strings.as_bytes()), ("xl/worksheets/sheet1.xml", sheet.as_bytes())]);
    let arrays = zip(&[
        ("time.npy", &column(0)),
        ("X#wcentroid.npy", &column(1)),
        ("Y#wcentroid.npy", &column(2)),
        ("rate.npy", &npy("'<f8'", "(1,)", &bytes(&[25.0]))),
    ]);
    for (file, part) in [
        (npy(fields, "(3,)", &bytes(&rows.concat())), "an array of NumPy with t, x, y"),
        (npy("'<f8'", "(3, 3)", &bytes(&rows.concat())), "an array of NumPy with 3 columns"),
        (arrays, "arrays of NumPy with time, X#wcentroid, Y#wcentroid"),
        (workbook.clone(), "the sheet of a workbook"),
    ] {
        let found = read(&file).unwrap_or_else(|e| panic!("{part}\n{e}"));
        assert_eq!(paths(&found.scene), known(0), "{part}");
        assert!(found.assumed.iter().any(|line| line.contains(part)), "{:?}", found.assumed);
    }
    for cut in 0..workbook.len() {
        let _ = read(&workbook[..cut]);
    }
    let pickled = read(&npy("'|O'", "()", b"\x80\x04")).unwrap_err().to_string();
    assert!(pickled.contains("numpy.savetxt"), "{pickled}");
}
