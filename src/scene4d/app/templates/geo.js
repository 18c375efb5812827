// Longitude and latitude of a place in a site that is tied to the Earth: +X is east, +Y north.
const A = 6378137; // WGS 84
const F = 1 / 298.257223563;
const B = A * (1 - F);

// The point at a distance and azimuth from the anchor along the ellipsoid: the azimuthal equidistant
// projection turned round (Vincenty, Survey Review 23, 1975: the direct problem).
export function lonLat({ latitude_deg, longitude_deg }, [x, y]) {
  const far = Math.hypot(x, y);
  if (!(far > 0)) return [longitude_deg, latitude_deg];
  const azimuth = Math.atan2(x, y);
  const [sinA, cosA] = [Math.sin(azimuth), Math.cos(azimuth)];
  const reduced = Math.atan((1 - F) * Math.tan((latitude_deg * Math.PI) / 180));
  const [sinU, cosU] = [Math.sin(reduced), Math.cos(reduced)];
  const first = Math.atan2(Math.tan(reduced), cosA);
  const sinAlpha = cosU * sinA;
  const cos2 = 1 - sinAlpha ** 2;
  const u2 = (cos2 * (A * A - B * B)) / (B * B);
  const P = 1 + (u2 / 16384) * (4096 + u2 * (-768 + u2 * (320 - 175 * u2)));
  const Q = (u2 / 1024) * (256 + u2 * (-128 + u2 * (74 - 47 * u2)));
  let sigma = far / (B * P);
  let [middle, sinS, cosS] = [0, 0, 0];
  for (let i = 0; i < 20; i++) {
    middle = Math.cos(2 * first + sigma);
    [sinS, cosS] = [Math.sin(sigma), Math.cos(sigma)];
    const inner = cosS * (2 * middle ** 2 - 1) - (Q / 6) * middle * (4 * sinS ** 2 - 3) * (4 * middle ** 2 - 3);
    const next = far / (B * P) + Q * sinS * (middle + (Q / 4) * inner);
    if (Math.abs(next - sigma) < 1e-13) break;
    sigma = next;
  }
  const [up, along] = [sinU * cosS + cosU * sinS * cosA, sinU * sinS - cosU * cosS * cosA];
  const latitude = Math.atan2(up, (1 - F) * Math.hypot(sinAlpha, along));
  const turn = Math.atan2(sinS * sinA, cosU * cosS - sinU * sinS * cosA);
  const C = (F / 16) * cos2 * (4 + F * (4 - 3 * cos2));
  const longer = turn - (1 - C) * F * sinAlpha * (sigma + C * sinS * (middle + C * cosS * (2 * middle ** 2 - 1)));
  const longitude = longitude_deg + (longer * 180) / Math.PI;
  return [((((longitude + 180) % 360) + 360) % 360) - 180, (latitude * 180) / Math.PI];
}

// Standard deviations (m) east and north of a place that was pointed at: the camera's own errors,
// those of its place in the site, and of pointing; null where the camera's are not known.
export function placeSigma(camera, { uv, xy }, clickPx) {
  const own = uv && camera.variances((one) => one.locate(...uv));
  if (!own) return null;
  const pointing = [0, 0];
  for (const axis of [0, 1]) {
    const [a, b] = [0.5, -0.5].map((by) => camera.locate(...uv.map((value, k) => value + (k === axis ? by : 0))));
    if (!a || !b) return null;
    for (const k of [0, 1]) pointing[k] += ((a[k] - b[k]) * clickPx) ** 2;
  }
  const placed = placedVariances(camera.said.placement, xy);
  return [0, 1].map((k) => Math.sqrt(own[k] + pointing[k] + placed[k]));
}

// As Placement.point_covariances: by x, y, heading and logarithm of the scale.
function placedVariances({ x_m, y_m, covariance }, [x, y]) {
  const [dx, dy] = [x - x_m, y - y_m];
  return [[1, 0, -dy, dx], [0, 1, dx, dy]].map((row) => {
    let sum = 0;
    for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) sum += row[i] * covariance[i][j] * row[j];
    return Math.max(0, sum);
  });
}
