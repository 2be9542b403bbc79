//! Starting values of a calibration: direct linear transforms on random minimal sets.
//!
//! Direct linear transform (DLT): the projective map M (3 x n) from homogeneous points `x` (n = 3 on a plane, 4 in space) to
//! pixels `(u, v)` satisfies `m1 x - u m3 x = 0` and `m2 x - v m3 x = 0` for each pair (m: rows of M). The vector of M's
//! entries (3n) that minimises the sum of squares is the eigenvector of the least eigenvalue of `A^T A` (3n x 3n), with image
//! and world normalised to mean 0 and standard deviation 1 (Hartley and Zisserman, Multiple View Geometry, 2nd ed., algorithms
//! 4.2 and 7.1). Of the maps of [`TRIALS`] random minimal sets and of all pairs, the one with the least median residual is
//! kept (Rousseeuw, 1984) and fitted again to the pairs within 2.5 such medians. Focal length and pose follow from a plane's
//! map as in Zhang (2000), from a spatial map by splitting `K R` (Hartley and Zisserman, section 6.2.4).

use crate::num::{Stop, Stopped, elementary, quantile};
use crate::scene::camera::lens_pose::{LensPose, PointPair, lens_pose};
use nalgebra::{DMatrix, Matrix3, Matrix3x4, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Fewest pairs: what the map of a plane needs.
pub(super) const MIN_PAIRS: usize = 4;
/// Fewest pairs for the map of a volume.
const MIN_SPATIAL_PAIRS: usize = 6;
/// Random minimal sets. With up to 40 % outliers one of them is almost certainly free of outliers.
const TRIALS: usize = 400;
/// Sets between two polls: some milliseconds.
const POLL_TRIALS: usize = 16;
/// Most pairs by which a map is judged.
const MAX_JUDGING_PAIRS: usize = 400;
/// Pairs with a residual up to this many medians are used for the last fit of a map.
const NEAR_MEDIANS: f64 = 2.5;
/// Thickness of the points, as a share of their extent, up to which a plane gives starting values.
pub(super) const MAX_PLANE_THICKNESS: f64 = 0.05;
/// Thickness of the points, as a share of their extent, from which a volume gives starting values.
pub(super) const MIN_VOLUME_THICKNESS: f64 = 0.01;
/// Width of the points, as a share of their extent, below which they lie on a line.
const MIN_WIDTH: f64 = 1e-3;
/// Likely focal length as a share of the image's width.
pub(super) const LIKELY_FOCAL: f64 = 1.2;

/// The plane that fits the world points best.
pub(super) struct PointPlane {
    pub centre: Vector3<f64>,
    /// Columns: two directions in the plane, and its normal, which points up; right-handed.
    axes: Matrix3<f64>,
    pub normal: Vector3<f64>,
    /// Standard deviation of the points across the plane as a share of the largest one along it.
    pub thickness: f64,
}

impl PointPlane {
    /// Fails with the field, `world` or `image`, whose points lie on one line.
    pub(super) fn of(pairs: &[PointPair]) -> Result<PointPlane, &'static str> {
        let n = pairs.len() as f64;
        let spread = |points: &dyn Fn(&PointPair) -> Vector3<f64>| {
            let centre = pairs.iter().map(points).sum::<Vector3<f64>>() / n;
            let offs = pairs.iter().map(|p| points(p) - centre);
            let scatter = offs.map(|d| d * d.transpose()).sum::<Matrix3<f64>>() / n;
            (centre, scatter.symmetric_eigen())
        };
        let extents = |eigen: &nalgebra::SymmetricEigen<f64, nalgebra::U3>| {
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            (order, order.map(|k| eigen.eigenvalues[k].max(0.0).sqrt()))
        };
        let (_, in_image) = spread(&|p| Vector3::new(p.image[0], p.image[1], 0.0));
        let (centre, eigen) = spread(&|p| Vector3::from(p.world));
        for (field, eigen) in [("world", &eigen), ("image", &in_image)] {
            let (_, [long, wide, _]) = extents(eigen);
            if wide <= MIN_WIDTH * long {
                return Err(field);
            }
        }
        let (order, [long, _, thick]) = extents(&eigen);
        let mut normal: Vector3<f64> = eigen.eigenvectors.column(order[2]).into_owned();
        if normal.z < 0.0 {
            normal = -normal;
        }
        let first: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
        let axes = Matrix3::from_columns(&[first, normal.cross(&first), normal]);
        Ok(PointPlane { centre, axes, normal, thickness: thick / long })
    }
}

/// Starting values for a camera of an image of this size (px).
pub(super) fn starting_values(
    pairs: &[PointPair],
    cloud: &PointPlane,
    size: [f64; 2],
    stop: Stop,
) -> Result<Vec<LensPose>, Stopped> {
    let mut starts: Vec<LensPose> = vec![];
    if cloud.thickness < MAX_PLANE_THICKNESS {
        let flat: Vec<([f64; 2], Vec<f64>)> = pairs
            .iter()
            .map(|p| {
                let along = cloud.axes.transpose() * (Vector3::from(p.world) - cloud.centre);
                (p.image, vec![along.x, along.y, 1.0])
            })
            .collect();
        if let Some(h) = least_median(&flat, MIN_PAIRS, stop)? {
            starts.extend(from_plane(&Matrix3::from_fn(|i, j| h[(i, j)]), cloud, size));
        }
    }
    if cloud.thickness >= MIN_VOLUME_THICKNESS && pairs.len() >= MIN_SPATIAL_PAIRS {
        let solid: Vec<([f64; 2], Vec<f64>)> =
            pairs.iter().map(|p| (p.image, vec![p.world[0], p.world[1], p.world[2], 1.0])).collect();
        let p = least_median(&solid, MIN_SPATIAL_PAIRS, stop)?;
        starts.extend(p.and_then(|p| from_matrix(&Matrix3x4::from_fn(|i, j| p[(i, j)]), size)));
    }
    Ok(starts)
}

/// The projective map (3 x n) from homogeneous points to pixels with the least median residual, over random minimal sets of
/// `minimal` pairs; fitted again to the pairs near it.
fn least_median(
    points: &[([f64; 2], Vec<f64>)],
    minimal: usize,
    stop: Stop,
) -> Result<Option<DMatrix<f64>>, Stopped> {
    let mut random = ChaCha8Rng::seed_from_u64(points.len() as u64);
    let stride = points.len().div_ceil(MAX_JUDGING_PAIRS);
    let judges: Vec<usize> = (0..points.len()).step_by(stride).collect();
    let residual = |map: &DMatrix<f64>, i: usize| {
        let (image, world) = &points[i];
        let [u, v, w] =
            [0, 1, 2].map(|r| world.iter().enumerate().map(|(c, x)| map[(r, c)] * x).sum::<f64>());
        elementary::hypot(u / w - image[0], v / w - image[1])
    };
    let median = |map: &DMatrix<f64>| {
        let mut residuals: Vec<f64> =
            judges.iter().map(|&i| residual(map, i)).filter(|m| m.is_finite()).collect();
        let enough = 2 * residuals.len() > judges.len();
        quantile(&mut residuals, 0.5).filter(|_| enough)
    };
    let all: Vec<usize> = (0..points.len()).collect();
    let mut candidates: Vec<DMatrix<f64>> = linear(points, &all).into_iter().collect();
    if points.len() >= 2 * MIN_PAIRS {
        for trial in 0..TRIALS {
            if trial % POLL_TRIALS == 0 {
                stop(0.0)?;
            }
            let mut set: Vec<usize> = vec![];
            while set.len() < minimal {
                let i = (random.next_u64() % points.len() as u64) as usize;
                if !set.contains(&i) {
                    set.push(i);
                }
            }
            candidates.extend(linear(points, &set));
        }
    }
    let mut judged = vec![];
    for (k, map) in candidates.into_iter().enumerate() {
        if k % POLL_TRIALS == 0 {
            stop(0.0)?;
        }
        judged.extend(median(&map).map(|median| (median, map)));
    }
    let best = judged.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((limit, map)) = best else { return Ok(None) };
    let near: Vec<usize> = all.into_iter().filter(|&i| residual(&map, i) <= NEAR_MEDIANS * limit).collect();
    let polished = linear(points, &near).filter(|p| median(p).is_some_and(|m| m <= limit));
    Ok(Some(polished.unwrap_or(map)))
}

/// Direct linear transform of the pairs `set`, with normalised coordinates.
fn linear(points: &[([f64; 2], Vec<f64>)], set: &[usize]) -> Option<DMatrix<f64>> {
    let columns = points.first()?.1.len();
    let n = set.len() as f64;
    let scaling = |value: &dyn Fn(usize, usize) -> f64, dims: usize| {
        let centre: Vec<f64> = (0..dims).map(|d| set.iter().map(|&i| value(i, d)).sum::<f64>() / n).collect();
        let square =
            |i: &usize| (0..dims).map(|d| elementary::powi(value(*i, d) - centre[d], 2)).sum::<f64>();
        let size = (set.iter().map(square).sum::<f64>() / n / dims as f64).sqrt();
        (size > 0.0).then(|| {
            DMatrix::from_fn(dims + 1, dims + 1, |r, c| match (r == c, c == dims) {
                (true, true) => 1.0,
                (true, false) => 1.0 / size,
                (false, true) => -centre[r] / size,
                _ => 0.0,
            })
        })
    };
    let to_image = scaling(&|i, d| points[i].0[d], 2)?;
    let to_world = scaling(&|i, d| points[i].1[d], columns - 1)?;
    let mut normal = DMatrix::zeros(3 * columns, 3 * columns);
    for &i in set {
        let ([u, v], world) = &points[i];
        let x = &to_world * nalgebra::DVector::from_column_slice(world);
        let p = &to_image * nalgebra::DVector::from_column_slice(&[*u, *v, 1.0]);
        for (at, coordinate) in [(0, p[0]), (1, p[1])] {
            let mut row = nalgebra::DVector::zeros(3 * columns);
            for c in 0..columns {
                row[at * columns + c] = x[c];
                row[2 * columns + c] = -coordinate * x[c];
            }
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = normal.symmetric_eigen();
    let least = (0..3 * columns).min_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]))?;
    let map = DMatrix::from_fn(3, columns, |r, c| eigen.eigenvectors[(r * columns + c, least)]);
    let map = to_image.try_inverse()? * map * to_world;
    map.iter().all(|v| v.is_finite()).then_some(map)
}

/// Starting values from the homography of the points' plane: with the focal length that it implies (square pixels, principal
/// point in the image's middle), and with likely focal lengths.
fn from_plane(h: &Matrix3<f64>, cloud: &PointPlane, size: [f64; 2]) -> Vec<LensPose> {
    let middle = Matrix3::new(1.0, 0.0, -0.5 * size[0], 0.0, 1.0, -0.5 * size[1], 0.0, 0.0, 1.0);
    let h = middle * h;
    let (a, b) = (h.column(0), h.column(1));
    // The columns of K^-1 H are perpendicular and of equal length (Zhang, 2000).
    let (perpendicular, across) = (a[0] * b[0] + a[1] * b[1], a[2] * b[2]);
    let (length, along) = (a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1], a[2] * a[2] - b[2] * b[2]);
    let square = -(perpendicular * across + length * along) / (across * across + along * along);
    let usual = LIKELY_FOCAL * size[0];
    let implied = Some(square.sqrt()).filter(|f| f.is_finite() && (0.1 * usual..10.0 * usual).contains(f));
    let focals = implied.into_iter().chain([0.5, 1.0, 2.0].map(|share| share * usual));
    let start = |focal: f64| {
        let bare = Matrix3::from_diagonal(&Vector3::new(1.0 / focal, 1.0 / focal, 1.0)) * h;
        let scale = 0.5 * (bare.column(0).norm() + bare.column(1).norm()) * bare[(2, 2)].signum();
        let bare = bare / scale;
        let (x, y, t): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
            (bare.column(0).into(), bare.column(1).into(), bare.column(2).into());
        let turn = nearest_rotation(&Matrix3::from_columns(&[x, y, x.cross(&y)]))? * cloud.axes.transpose();
        lens_pose(focal, [0.0; 2], &turn, t - turn * cloud.centre)
    };
    focals.filter_map(start).collect()
}

/// The starting value from a projection matrix.
fn from_matrix(p: &Matrix3x4<f64>, size: [f64; 2]) -> Option<LensPose> {
    let left = p.fixed_view::<3, 3>(0, 0).into_owned();
    let p = p * (left.determinant().signum() / left.row(2).norm());
    let row = |i: usize| Vector3::new(p[(i, 0)], p[(i, 1)], p[(i, 2)]);
    let (cx, cy) = (row(0).dot(&row(2)), row(1).dot(&row(2)));
    let (x, y) = (row(0) - row(2) * cx, row(1) - row(2) * cy);
    let (fx, fy) = (x.norm(), y.norm());
    let turn = nearest_rotation(&Matrix3::from_rows(&[
        (x / fx).transpose(),
        (y / fy).transpose(),
        row(2).transpose(),
    ]))?;
    let t = Vector3::new((p[(0, 3)] - cx * p[(2, 3)]) / fx, (p[(1, 3)] - cy * p[(2, 3)]) / fy, p[(2, 3)]);
    lens_pose((fx * fy).sqrt(), [cx - 0.5 * size[0], cy - 0.5 * size[1]], &turn, t)
}

/// The rotation nearest to a matrix in the Frobenius norm; `None` for a mirrored one.
fn nearest_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = m.svd(true, true);
    let turn = svd.u? * svd.v_t?;
    (turn.determinant() > 0.0).then_some(turn)
}
