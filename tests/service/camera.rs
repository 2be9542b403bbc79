//! Image points, detections and calibration, over the wire.

use crate::harness::{CAPACITY, fields, start};
use tonic::Status;
use vrdp::api::v1::{self, sample::Place};
use vrdp::num::vec2;
use vrdp::scene::CLEVRER_CAMERA;

/// CLEVRER's camera, in parts.
fn parts() -> v1::Camera {
    let (c, s) = (0.866025, 0.5);
    v1::Camera {
        image_width: 480.0,
        image_height: 320.0,
        intrinsics: Some(v1::Intrinsics { focal_u: 525.0, focal_v: 0.0, centre_u: 240.0, centre_v: 160.0 }),
        pose: Some(v1::Pose {
            rotation: vec![0.0, 1.0, 0.0, s, 0.0, -c, -c, 0.0, -s],
            translation: vec![0.0, 0.0, 5.0],
        }),
        ..Default::default()
    }
}

fn matrix() -> v1::Camera {
    v1::Camera {
        matrix: CLEVRER_CAMERA.matrix.concat(),
        image_width: 480.0,
        image_height: 320.0,
        ..Default::default()
    }
}

/// A ball that rolls past, as image points.
fn imaged(camera: v1::Camera) -> v1::Video {
    let sample = |frame: u32| {
        let [u, v] = CLEVRER_CAMERA.project(vec2(-1.0 + 0.05 * f64::from(frame), 0.5), 0.2).unwrap();
        v1::Sample { frame, place: Some(Place::Image(v1::ImagePoint { u, v })), ..Default::default() }
    };
    let shape = v1::Shape { kind: Some(v1::shape::Kind::Ball(v1::shape::Ball { radius: 0.2 })) };
    let ball = v1::Object {
        id: 3,
        shape: Some(shape),
        samples: (0..30).map(sample).collect(),
        ..Default::default()
    };
    v1::Video {
        display_name: "pixels".into(),
        camera: Some(camera),
        objects: vec![ball],
        ..Default::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn image_points_become_positions_or_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut videos = service.videos();
    let request = |video| v1::CreateVideoRequest { video: Some(video), ..Default::default() };
    for camera in [matrix(), parts()] {
        let made = videos.create_video(request(imaged(camera))).await.unwrap().into_inner();
        for sample in &made.objects[0].samples {
            let Some(Place::Position(p)) = &sample.place else { panic!("{sample:?}") };
            assert!((p.x + 1.0 - 0.05 * f64::from(sample.frame)).abs() < 1e-3 && (p.y - 0.5).abs() < 1e-3);
            let c = sample.covariance.unwrap();
            // Depth is measured less well than the direction across.
            assert!(c.xx > 2.0 * c.yy && c.yy > 0.0, "{c:?}");
        }
        assert_eq!(
            service.create(made.clone()).await.unwrap(),
            made.name,
            "what the reply holds may be posted again"
        );
    }
    let refused = |change: fn(&mut v1::Video)| {
        let mut video = imaged(matrix());
        change(&mut video);
        video
    };
    type Case = (fn(&mut v1::Video), &'static str);
    let cases: [Case; 8] = [
        (|v| v.camera = None, "video.camera"),
        (|v| v.camera.as_mut().unwrap().matrix = vec![1.0; 12], "video.camera.matrix"),
        (|v| v.camera.as_mut().unwrap().matrix[..4].iter_mut().for_each(|m| *m = -*m), "video.camera.matrix"),
        (
            |v| {
                v.camera = Some(parts());
                v.camera.as_mut().unwrap().pose.as_mut().unwrap().rotation = vec![120.0, 0.0, 90.0];
            },
            "video.camera.pose.rotation",
        ),
        (
            |v| {
                v.camera = Some(parts());
                v.camera.as_mut().unwrap().intrinsics = None;
            },
            "video.camera.intrinsics",
        ),
        (
            |v| v.objects[0].samples[7].place = Some(Place::Image(v1::ImagePoint { u: 240.0, v: -150.0 })),
            "video.objects[0].samples[7].image",
        ),
        (|v| v.image_noise_px = -1.0, "video.image_noise_px"),
        (
            |v| v.objects[0].samples[4].place = Some(Place::Image(v1::ImagePoint { u: f64::NAN, v: 0.0 })),
            "video.objects[0].samples[4].image",
        ),
    ];
    for (change, field) in cases {
        let status = videos.create_video(request(refused(change))).await.unwrap_err();
        assert_eq!(fields(&status), [field], "{status:?}");
    }
    drop(videos);
    service.stop().await;
}

fn word(word: &str) -> Vec<v1::Score> {
    vec![v1::Score { word: word.into(), score: 0.0 }]
}

/// Boxes around two objects, one of them hidden for some frames, and one false box; last frame first.
fn detections() -> Vec<v1::Detection> {
    let mut all = vec![];
    for frame in (0..25u32).rev() {
        for (k, color) in ["red", "blue"].into_iter().enumerate() {
            if k == 1 && (10..14).contains(&frame) {
                continue;
            }
            let at = vec2(-1.0 + 0.04 * f64::from(frame), 1.5 * k as f64 - 0.7);
            let [u, v] = CLEVRER_CAMERA.project(at, 0.2).unwrap();
            let region = v1::detection::Region::Box(v1::Box {
                left: u - 20.0,
                top: v - 20.0,
                width: 40.0,
                height: 40.0,
            });
            all.push(v1::Detection {
                frame,
                region: Some(region),
                color: word(color),
                shape: word("sphere"),
                ..Default::default()
            });
        }
    }
    let runs = vec![1000, 20, 152_580];
    let mask = v1::Mask { height: 320, width: 480, runs, ..Default::default() };
    all.push(v1::Detection {
        frame: 5,
        region: Some(v1::detection::Region::Mask(mask)),
        ..Default::default()
    });
    all
}

#[tokio::test(flavor = "multi_thread")]
async fn features_of_detections_are_kept_bounded_and_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut videos = service.videos();
    let request = |detections| v1::CreateVideoRequest {
        video: Some(v1::Video { camera: Some(matrix()), ..Default::default() }),
        detections,
        ..Default::default()
    };
    let plain = videos.create_video(request(detections())).await.unwrap().into_inner();
    assert!(plain.objects.iter().all(|o| o.features.is_empty()));
    // A red body's features are 1 in all frames, a blue one's 3 and, where the detector is half as sure, 0; a false box has none.
    let mut given = detections();
    for d in &mut given {
        let (is_red, is_sure) = (d.color.first().is_some_and(|c| c.word == "red"), d.frame >= 14);
        (d.score, d.features) = match (d.color.is_empty(), is_red, is_sure) {
            (true, ..) => (0.0, vec![]),
            (_, true, _) => (0.8, vec![1.0; 1024]),
            (_, _, true) => (0.8, vec![3.0; 1024]),
            _ => (0.4, vec![0.0; 1024]),
        };
    }
    let made = videos.create_video(request(given.clone())).await.unwrap().into_inner();
    assert_ne!(made.name, plain.name);
    let get = v1::GetVideoRequest { name: made.name.clone(), read_mask: None };
    let kept = videos.get_video(get).await.unwrap().into_inner();
    for object in &kept.objects {
        // 11 sure frames and 10 unsure ones of the blue body.
        let mean = if object.color == "red" { 1.0 } else { 3.0 * 11.0 * 0.8 / (11.0 * 0.8 + 10.0 * 0.4) };
        assert_eq!(object.features.len(), 1024);
        assert!(
            object.features.iter().all(|f| (f64::from(*f) - mean).abs() < 1e-6),
            "{}",
            object.features[0]
        );
    }
    assert_eq!(service.create(kept).await.unwrap(), made.name, "what the reply holds may be posted again");
    let listed = videos.list_videos(v1::ListVideosRequest::default()).await.unwrap().into_inner().videos;
    assert!(listed.len() == 2 && listed.iter().flat_map(|v| &v.objects).all(|o| o.features.is_empty()));

    type Wrong = (fn(&mut v1::Detection), &'static str);
    let cases: [Wrong; 3] = [
        (|d| d.features = vec![0.0; 1025], "at most 1024"),
        (|d| d.features[7] = f32::NAN, "number 7 is NaN; give finite numbers"),
        (|d| d.features.truncate(256), "has 256 numbers, but those before have 1024"),
    ];
    for (change, message) in cases {
        let mut wrong = given.clone();
        change(&mut wrong[3]);
        let status = videos.create_video(request(wrong)).await.unwrap_err();
        assert_eq!(fields(&status), ["detections[3].features"]);
        assert!(status.message().contains(message), "{status:?}");
    }
    let mut wrong = made;
    wrong.objects[1].features.pop();
    let status = videos
        .create_video(v1::CreateVideoRequest { video: Some(wrong), ..Default::default() })
        .await
        .unwrap_err();
    assert_eq!(fields(&status), ["video.objects[1].features"]);
    drop(videos);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn detections_are_linked_and_the_reply_says_how() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut videos = service.videos();
    let request = |detections, camera| v1::CreateVideoRequest {
        video: Some(v1::Video { display_name: "found".into(), camera, ..Default::default() }),
        detections,
        ..Default::default()
    };
    let made = videos.create_video(request(detections(), Some(matrix()))).await.unwrap().into_inner();
    let expected = v1::Linking {
        frames: 25,
        detections: 47,
        objects: 2,
        gaps_bridged: 1,
        frames_bridged: 4,
        detections_dropped: 1,
    };
    assert_eq!(made.linking, Some(expected));
    let mut colors: Vec<&str> = made.objects.iter().map(|o| o.color.as_str()).collect();
    colors.sort();
    assert_eq!(colors, ["blue", "red"]);
    let (_, model) = service.fit(&made.name).await.unwrap();
    assert!(model.objects.len() == 2 && model.rmse.is_finite());

    type Wrong = (fn(&mut v1::Detection), &'static str);
    let cases: [Wrong; 6] = [
        (|d| d.region = None, "detections[0].region"),
        (|d| *d = boxed(600.0, 20.0, 30.0, 30.0), "detections[0].box"),
        (|d| *d = boxed(60.0, 20.0, 0.0, 30.0), "detections[0].box"),
        (|d| *d = masked("9~~"), "detections[0].mask"),
        (|d| *d = masked("55"), "detections[0].mask"),
        (|d| d.score = f64::NAN, "detections[0].score"),
    ];
    for (change, field) in cases {
        let mut given = detections();
        change(&mut given[0]);
        let status: Status = videos.create_video(request(given, Some(matrix()))).await.unwrap_err();
        assert_eq!(fields(&status), [field]);
        assert!(status.message().contains("frame"), "{status:?}");
    }
    let status = videos.create_video(request(detections(), None)).await.unwrap_err();
    assert_eq!(fields(&status), ["video.camera"]);
    drop(videos);
    service.stop().await;
}

fn boxed(left: f64, top: f64, width: f64, height: f64) -> v1::Detection {
    let region = v1::detection::Region::Box(v1::Box { left, top, width, height });
    v1::Detection { frame: 2, region: Some(region), ..Default::default() }
}

fn masked(counts: &str) -> v1::Detection {
    let mask = v1::Mask { height: 320, width: 480, counts: counts.into(), ..Default::default() };
    v1::Detection { frame: 2, region: Some(v1::detection::Region::Mask(mask)), ..Default::default() }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_camera_is_estimated_from_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut videos = service.videos();
    let pair = |k: u32| {
        let (x, y) = (f64::from(k % 5) * 0.8 - 2.0, f64::from(k / 5) * 0.8 - 2.0);
        let [u, v] = CLEVRER_CAMERA.project(vec2(x, y), 0.0).unwrap();
        v1::PointPair { u, v, x, y, z: 0.0 }
    };
    let pairs: Vec<v1::PointPair> = (0..25).map(pair).collect();
    let request = |pairs| v1::CalibrateCameraRequest { pairs, image_width: 480.0, image_height: 320.0 };
    let found = videos.calibrate_camera(request(pairs.clone())).await.unwrap().into_inner();
    assert!(found.reprojection_error < 0.05 && found.planar && found.outliers.is_empty(), "{found:?}");
    let status = videos.calibrate_camera(request(pairs[..3].to_vec())).await.unwrap_err();
    assert_eq!(fields(&status), ["pairs"]);
    let mut broken = pairs.clone();
    broken[6].u = f64::INFINITY;
    let status = videos.calibrate_camera(request(broken)).await.unwrap_err();
    assert_eq!(fields(&status), ["pairs[6].image"]);
    let mirrored: Vec<v1::PointPair> = pairs.iter().map(|p| v1::PointPair { x: p.y, y: p.x, ..*p }).collect();
    let status = videos.calibrate_camera(request(mirrored)).await.unwrap_err();
    assert!(fields(&status) == ["pairs"] && status.message().contains("mirrored"), "{status:?}");
    drop(videos);
    service.stop().await;
}
