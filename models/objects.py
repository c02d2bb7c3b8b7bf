#!/usr/bin/env python3
"""Trains the network that tells vehicles, pedestrians and riders: models/objects.onnx and models/objects-free.onnx.

    python3 -m venv venv && venv/bin/pip install numpy "opencv-python-headless<5" torch onnx
    venv/bin/python models/objects.py scenes crowds --seeds 0-59
    lookout evaluate classes crowds/*.toml --frames 90 --examples crowd-examples
    lookout evaluate classes "random?weather=sunny" --seeds 1000-1043 --frames 90 --examples street-examples
    venv/bin/python models/objects.py train --examples crowd-examples street-examples \
        --regions models/regions-free.csv data -o objects-free.onnx
    venv/bin/python models/objects.py train --examples crowd-examples street-examples \
        --regions models/regions.csv data --patches data/vehicle_patches -o objects.onnx

`scenes` writes scenes with many pedestrians and riders. `lookout evaluate classes --examples` writes what the road stage
found in scenes, by class: 64 x 64 pixels, the region with a quarter of its side around it. `--patches` is a folder with
the folders `vehicles` and `non-vehicles` of pictures that one object fills; the last 30 % of each of their folders are
held back. The same pictures give the same network on one machine, up to the order of sums in PyTorch's threads.
"""

import argparse
import hashlib
import pathlib
import random
import re
import sys
import time

LABELS = ["other", "vehicle", "pedestrian", "rider"]
SIDE = 32
# Pairs of a height in metres and the smallest width up to there, as a share of the height: a strip of a wall is no vehicle.
SIZES = "vehicle 2.2 0.35 4.3 0.6, pedestrian 2.3 0.15, rider 2.5 0.2"
# Of a region on each side; examples have a quarter.
MARGIN = 0.1
EXAMPLE_MARGIN = 0.25
# Share of the pictures of other things, and of vehicles, of which a part is taken.
PARTS_OF_OTHERS, PARTS_OF_VEHICLES = 0.5, 0.3
# Windows at random of each street picture.
WINDOWS = 120
# Added to the standard deviation of an input of 0 to 1: `MIN_CONTRAST` of the recogniser.
MIN_CONTRAST = 8 / 255


# Scenes.

WEATHERS = ["sunny", "overcast", "light_rain", "heavy_rain", "night", "snow", "backlight"]
ROWS = ["buildings", "trees", "hedge", "wall", "fence", "parked_cars", "bushes", "stone_wall"]
HEIGHTS_M = [1.05, 1.2, 1.6, 1.7, 1.75, 1.8, 1.9]


def table(name, **keys):
    def text(value):
        return f'"{value}"' if isinstance(value, str) else str(value)

    return f"[{name}]\n" + "".join(f"{key} = {text(value)}\n" for key, value in keys.items())


def crowd(seed):
    """A scene with 22 pedestrians, 16 riders and 3 other things."""
    r = random.Random(seed)
    parts = [
        f'title = "people and riders, {seed}"\nseconds = 9\nseed = {seed}\n'
        f'weather = "{WEATHERS[seed % len(WEATHERS)]}"\n',
        table("camera", rig=r.choice(["paper", "paper", "kitti", "board"])),
        table("ego", speed_m_s=round(r.uniform(2, 8), 1)),
        table("road", edges_m=[-5.25, 5.25], kerb_m=0.12, pavement_m=3, solid_m=[-5, 5], dashed_m=[-1.75, 1.75]),
    ]
    for side in (-1, 1):
        lateral_m = round(side * r.uniform(7.5, 10), 1)
        parts.append(table("[beside]", kind=r.choice(ROWS), lateral_m=lateral_m, from_m=0, to_m=150))

    def add(kind, along_m, lateral_m, speed_m_s, across_m_s, yaw_deg, **keys):
        parts.append(table("[objects]", kind=kind, along_m=round(along_m, 1), lateral_m=round(lateral_m, 1),
                           speed_m_s=round(speed_m_s, 2), across_m_s=round(across_m_s, 2), yaw_deg=yaw_deg,
                           grey=r.randint(30, 215), **keys))

    for _ in range(22):
        height_m = r.choice(HEIGHTS_M)
        size_m = [round(height_m * r.uniform(0.27, 0.34), 2), height_m, round(height_m / 4, 2)]
        along_m = r.uniform(5, 90)
        if r.random() < 0.6:
            across = r.choice([-1, 1]) * r.uniform(5.4, 7.4)
            add("pedestrian", along_m, across, r.uniform(-2, 2), 0, r.choice([0, 90, 180, 270]), size_m=size_m)
        else:
            speed = r.choice([-1, 1]) * r.uniform(0.3, 1.8)
            add("pedestrian", along_m, r.uniform(-7, 7), 0, speed, 90 if speed > 0 else 270, size_m=size_m)
    for _ in range(16):
        kind, along_m = r.choice(["cyclist", "cyclist", "motorcyclist"]), r.uniform(6, 100)
        way = r.random()
        if way < 0.4:
            add(kind, along_m, r.uniform(1, 4.8), r.uniform(2, 8), 0, 0)
        elif way < 0.7:
            add(kind, along_m, -r.uniform(1, 4.8), -r.uniform(2, 8), 0, 180)
        else:
            speed = r.choice([-1, 1]) * r.uniform(1, 4)
            add(kind, along_m, r.uniform(-6, 6), 0, speed, 90 if speed > 0 else 270)
    for _ in range(3):
        kind = r.choice(["car", "van", "lorry", "bus", "cone", "pole", "debris", "block"])
        add(kind, r.uniform(10, 70), r.choice([-1, 1]) * r.uniform(2, 4.5), r.uniform(0, 6), 0, r.choice([0, 90, 180]))
    return "\n".join(parts)


def write_scenes(args):
    folder = pathlib.Path(args.folder)
    folder.mkdir(parents=True, exist_ok=True)
    first, last = (int(seed) for seed in args.seeds.split("-"))
    for seed in range(first, last + 1):
        (folder / f"crowd{seed}.toml").write_text(crowd(seed))


# Pictures.


def by_number(path):
    """Frame 9 comes before frame 10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", str(path))]


def read(path):
    import cv2

    return cv2.resize(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), (64, 64), interpolation=cv2.INTER_AREA)


def read_examples(folders):
    """Pictures, labels, and whether they are for validation: one street of eight."""
    pictures, labels, held = [], [], []
    for folder in folders:
        for label, name in enumerate(LABELS):
            for path in sorted(pathlib.Path(folder, name).glob("*.png"), key=by_number):
                # The name without frame and track is that of the scene.
                scene = path.stem.rsplit("-", 2)[0]
                pictures.append(read(path))
                labels.append(label)
                held.append(hashlib.sha256(scene.encode()).digest()[0] % 8 == 0)
    return pictures, labels, held


def overlaps(a, b):
    """Whether two boxes share a twentieth of the smaller one."""
    across = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    down = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    return across > 0 and down > 0 and across * down > 0.05 * min(a[2] * a[3], b[2] * b[3])


def read_regions(file, root):
    """Pictures, labels, and whether they are for validation: one street picture of eight. Of each street picture there are
    also windows at random, away from all that is not clearly something else."""
    import cv2

    boxes = {}
    for line in pathlib.Path(file).read_text().splitlines():
        if not line.startswith(("#", "picture,")):
            name, *box, label = line.split(",")
            boxes.setdefault(name, []).append(([int(v) for v in box], label))
    pictures, labels, held = [], [], []
    for name, known in boxes.items():
        image = cv2.imread(str(pathlib.Path(root, name)), cv2.IMREAD_GRAYSCALE)
        rows, columns = image.shape
        digest = hashlib.sha256(name.encode()).digest()
        r = random.Random(digest)
        for _ in range(WINDOWS):
            height = int(20 * 10 ** r.random())
            width = int(height * 0.3 * 8 ** r.random())
            top = r.randrange(rows // 5, max(rows - height // 2, rows // 5 + 1))
            box = [r.randrange(max(columns - width, 1)), top, width, height]
            if all(label == "other" or not overlaps(box, other) for other, label in known):
                known = known + [(box, "other")]
        for (x, y, width, height), label in known:
            if label not in LABELS:
                continue
            # With the margin of an example; where the picture ends its outermost pixels go on.
            across, down = round(EXAMPLE_MARGIN * width), round(EXAMPLE_MARGIN * height)
            below = max(y + height - rows, 0)
            wide = cv2.copyMakeBorder(image, down, down + below, across, across + width, cv2.BORDER_REPLICATE)
            part = wide[y:y + height + 2 * down, x:x + width + 2 * across]
            pictures.append(cv2.resize(part, (64, 64), interpolation=cv2.INTER_AREA))
            labels.append(LABELS.index(label))
            held.append(digest[0] % 8 == 0)
    return pictures, labels, held


def read_patches(folder, shares):
    """Pictures, labels, and of which part they are: 0 to learn from, 1 for validation, 2 held back. The parts of each
    folder end at these shares of its pictures."""
    pictures, labels, parts = [], [], []
    for name, label in (("vehicles", 1), ("non-vehicles", 0)):
        for sequence in sorted(path for path in pathlib.Path(folder, name).iterdir() if path.is_dir()):
            paths = sorted(sequence.glob("*.png"), key=by_number)
            ends = [round(share * len(paths)) for share in shares]
            for i, path in enumerate(paths):
                pictures.append(read(path))
                labels.append(label)
                parts.append(sum(i >= end for end in ends))
    return pictures, labels, parts


# Training.


def build():
    from torch import nn

    def block(inputs, outputs):
        return [nn.Conv2d(inputs, outputs, 3, padding=1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU()]

    return nn.Sequential(
        *block(1, 16), *block(16, 16), nn.MaxPool2d(2), *block(16, 32), *block(32, 32), nn.MaxPool2d(2),
        *block(32, 32), nn.MaxPool2d(2), nn.Flatten(), nn.Dropout(0.3), nn.Linear(32 * 16, len(LABELS)),
    )


def normalised(x):
    mean, spread = x.mean((2, 3), keepdim=True), x.std((2, 3), keepdim=True, unbiased=False)
    return (x - mean) / (spread + MIN_CONTRAST)


def window(pictures, scale, shift, turn, flip):
    """The inputs that lie in a window of each picture: its side as a share of the picture's, and its middle."""
    import torch
    from torch.nn import functional as F

    theta = torch.zeros(len(pictures), 2, 3)
    theta[:, 0, 0], theta[:, 0, 1] = scale[:, 0] * flip, -turn
    theta[:, 1, 0], theta[:, 1, 1] = turn, scale[:, 1]
    theta[:, :, 2] = shift
    # Twice the side and then the mean of four: pictures are reduced without aliasing.
    grid = F.affine_grid(theta, [len(pictures), 1, 2 * SIDE, 2 * SIDE], align_corners=False)
    return F.avg_pool2d(F.grid_sample(pictures, grid, align_corners=False, padding_mode="border"), 2)


def straight(pictures, is_patch):
    """The inputs as the recogniser would see them."""
    import torch

    scale = torch.where(is_patch, 1.0, (1 + 2 * MARGIN) / (1 + 2 * EXAMPLE_MARGIN))
    zero = torch.zeros(len(pictures))
    return window(pictures, scale[:, None].repeat(1, 2), zero[:, None].repeat(1, 2), zero, zero + 1)


def augmented(pictures, is_patch, labels):
    import torch
    from torch.nn import functional as F

    n = len(pictures)

    def uniform(low, high, *sides):
        return torch.empty(n, *sides).uniform_(low, high)

    base = torch.where(is_patch, 1.0, (1 + 2 * MARGIN) / (1 + 2 * EXAMPLE_MARGIN))
    scale = base[:, None] * uniform(0.82, 1.2, 1) * uniform(0.9, 1.1, 2)
    shift = base[:, None] * uniform(-0.14, 0.14, 2)
    # A part of something else is something else, and a part of a vehicle a vehicle: boxes of near ones often miss an end.
    part = torch.rand(n) < torch.tensor([PARTS_OF_OTHERS, PARTS_OF_VEHICLES, 0.0, 0.0])[labels]
    smaller = torch.stack([torch.empty(n).uniform_(0.4, 1.0), torch.empty(n).uniform_(0.55, 1.0)], 1)
    other = part & labels.eq(0)
    scale = torch.where(part[:, None], scale * smaller, scale)
    room = torch.where(other, 1.0, base)[:, None]
    shift = torch.where(part[:, None], (room - scale).clamp(min=0) * uniform(-1, 1, 2), shift)
    flip = torch.where(torch.rand(n) < 0.5, -1.0, 1.0)
    y = window(pictures, scale, shift, torch.empty(n).normal_(0, 0.03), flip)
    y = y.clamp(1e-3, 1) ** torch.exp(torch.empty(n, 1, 1, 1).normal_(0, 0.3))
    y = y * uniform(0.35, 1.1, 1, 1, 1) + uniform(-0.05, 0.15, 1, 1, 1)
    soft = torch.rand(n) < 0.3
    if soft.any():
        y[soft] = F.avg_pool2d(F.pad(y[soft], (1, 1, 1, 1), mode="replicate"), 3, 1)
    coarse = torch.rand(n) < 0.2
    if coarse.any():
        y[coarse] = F.interpolate(F.avg_pool2d(y[coarse], 2), scale_factor=2.0, mode="bilinear", align_corners=False)
    # A thing in front, or the end of the picture.
    for i in torch.nonzero(torch.rand(n) < 0.25)[:, 0].tolist():
        side, depth = random.randrange(4), random.randrange(2, SIDE // 4)
        part = [y[i, :, :depth], y[i, :, -depth:], y[i, :, :, :depth], y[i, :, :, -depth:]][side]
        part[:] = random.random()
    y = y + torch.randn_like(y) * uniform(0, 0.03, 1, 1, 1)
    return y.clamp(0, 1)


def report(name, log_odds, labels):
    """Hits of vehicles by their log-odds at false-alarm rates."""
    import numpy as np

    vehicle = labels == 1
    order = np.sort(log_odds[~vehicle])[::-1]
    rates = {share: float((log_odds[vehicle] > order[int(share * len(order))]).mean()) for share in (0.005, 0.01, 0.02)}
    at = (log_odds[vehicle] > 0).mean(), (order > 0).mean()
    text = ", ".join(f"{hits:.3f} at {share:.1%}" for share, hits in rates.items())
    print(f"{name}: vehicles {vehicle.sum()}, others {(~vehicle).sum()}: hits {text} of false alarms; "
          f"{at[0]:.3f} at {at[1]:.2%} where more likely than not")


def train(args):
    import numpy as np
    import torch
    from torch.nn import functional as F

    torch.manual_seed(args.seed)
    random.seed(args.seed)
    torch.use_deterministic_algorithms(True)
    pictures, labels, held = read_examples(args.examples)
    # 0 rendered, 1 regions of real pictures, 2 patches.
    kinds = [0] * len(pictures)
    if args.regions:
        more, their_labels, their_held = read_regions(*args.regions)
        pictures, labels, held = pictures + more, labels + their_labels, held + their_held
        kinds += [1] * len(more)
    parts = [int(h) for h in held]
    judged = read_patches(args.judge, args.shares) if args.judge else ([], [], [])
    if args.patches:
        more, their_labels, their_parts = read_patches(args.patches, args.shares)
        pictures, labels, parts = pictures + more, labels + their_labels, parts + their_parts
        kinds += [2] * len(more)
    if not pictures:
        sys.exit("no pictures: give --examples or --patches")
    pictures = torch.tensor(np.array(pictures)).float()[:, None] / 255
    labels, parts, kinds = torch.tensor(labels), torch.tensor(parts), torch.tensor(kinds)
    is_patch = kinds.eq(2)
    for part, name in enumerate(["learned from", "validation", "held back"]):
        for kind, source in enumerate(["scenes", "regions of pictures", "patches"]):
            counts = torch.bincount(labels[kinds.eq(kind) & parts.eq(part)], minlength=len(LABELS)).tolist()
            if any(counts):
                print(f"{name}, {source}: {dict(zip(LABELS, counts))}", flush=True)
    learned = torch.nonzero(parts.eq(0))[:, 0]
    # Each class of each kind is drawn equally often, but rare ones not more than 12 times in an epoch.
    group = labels[learned] + len(LABELS) * kinds[learned]
    share = 1 / torch.bincount(group).clamp(min=1).float()[group]
    share = share / share.sum() * len(learned)
    share = share.clamp(max=12.0)
    net = build()
    print(f"{sum(p.numel() for p in net.parameters())} weights", flush=True)
    steps = args.epochs * (len(learned) // args.batch)
    optimiser = torch.optim.AdamW(net.parameters(), args.rate, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, args.rate, total_steps=steps)
    begin, count = time.time(), 0
    for epoch in range(args.epochs):
        drawn = learned[torch.multinomial(share, len(learned), replacement=True)]
        total = 0.0
        for first in range(0, len(drawn) - args.batch + 1, args.batch):
            rows = drawn[first:first + args.batch]
            logits = net(normalised(augmented(pictures[rows], is_patch[rows], labels[rows])))
            loss = F.cross_entropy(logits, labels[rows], label_smoothing=0.03)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total, count = total + loss.item(), count + 1
        print(f"epoch {epoch + 1} of {args.epochs}: loss {total / (len(drawn) // args.batch):.4f}, "
              f"{time.time() - begin:.0f} s", flush=True)
    net.eval()

    def logits_of(x, patch):
        with torch.no_grad():
            return torch.cat([net(normalised(straight(x[i:i + 512], patch[i:i + 512]))) for i in range(0, len(x), 512)])

    # The factor of all logits that makes the probabilities of the validation truest.
    rows = parts.eq(1)
    known = logits_of(pictures[rows], is_patch[rows])
    factors = torch.linspace(0.3, 3.0, 271)
    losses = torch.stack([F.cross_entropy(f * known, labels[rows]) for f in factors])
    factor = factors[losses.argmin()].item()
    print(f"logits times {factor:.2f}: loss of validation {losses.min():.4f}, without {F.cross_entropy(known, labels[rows]):.4f}")
    with torch.no_grad():
        net[-1].weight *= factor
        net[-1].bias *= factor

    def odds(logits, k):
        others = [i for i in range(len(LABELS)) if i != k]
        return (logits[:, k] - logits[:, others].logsumexp(1)).numpy()

    chosen = logits_of(pictures[rows], is_patch[rows])
    table = torch.zeros(len(LABELS), len(LABELS), dtype=torch.int)
    for truth, told in zip(labels[rows].tolist(), chosen.argmax(1).tolist()):
        table[truth, told] += 1
    print("validation, rows are the truth:", *(f"{name} {row.tolist()}" for name, row in zip(LABELS, table)), sep="\n  ")
    sets = [("validation", pictures[rows], labels[rows], is_patch[rows])]
    for kind, source in ((1, "regions of pictures"), (2, "patches")):
        some = rows & kinds.eq(kind)
        if some.any():
            sets.append((f"validation, {source}", pictures[some], labels[some], is_patch[some]))
    if args.patches:
        last = parts.eq(2)
        sets.append(("patches held back", pictures[last], labels[last], is_patch[last]))
    if args.judge:
        some = torch.tensor(np.array(judged[0])).float()[:, None] / 255
        last = torch.tensor(judged[2]).eq(2)
        sets.append(("patches, of which none was learned from", some[last], torch.tensor(judged[1])[last],
                     torch.ones(int(last.sum()), dtype=torch.bool)))
    for name, x, truth, patch in sets:
        report(name, odds(logits_of(x, patch), 1), truth.numpy())
    write(net, args.out)
    if args.check:
        write_check(net, args.check)


def check_picture(seed):
    import numpy as np

    y, x = np.mgrid[0:SIDE, 0:SIDE].astype(np.int64)
    block = (x // 5 * 31 + y // 7 * 17 + seed * 13) * 2654435761 % 4294967296
    return (block >> 24) // 2 + (x * 3 + y * (seed + 1)) % 97


def write_check(net, path):
    """Log-odds of pictures that the test of the network computes, too."""
    import numpy as np
    import torch

    pictures = np.stack([check_picture(seed) for seed in range(6)])
    with torch.no_grad():
        logits = net(normalised(torch.tensor(pictures).float()[:, None] / 255))
    rows = torch.stack([logits[:, k] - logits[:, [i for i in range(len(LABELS)) if i != k]].logsumexp(1)
                        for k in range(len(LABELS))], dim=1)
    lines = "".join(" ".join(f"{v:.7g}" for v in row) + "\n" for row in rows.tolist())
    pathlib.Path(path).write_text(f"# models/objects.py: log-odds, by PyTorch {torch.__version__.split('+')[0]}\n{lines}")


def write(net, path):
    import onnx
    import torch

    torch.onnx.export(net, torch.zeros(1, 1, SIDE, SIDE), path, input_names=["grey"], output_names=["logits"],
                      opset_version=17, dynamo=False)
    model = onnx.load(path)
    for key, value in (("labels", ",".join(LABELS)), ("margin", str(MARGIN)), ("sizes", SIZES)):
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    model.doc_string = "models/objects.py"
    onnx.save(model, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    scenes = commands.add_parser("scenes", help="write scenes with pedestrians and riders")
    scenes.add_argument("folder")
    scenes.add_argument("--seeds", default="0-59", metavar="A-B")
    scenes.set_defaults(run=write_scenes)
    learn = commands.add_parser("train", help="train a network")
    learn.add_argument("--examples", nargs="*", default=[], metavar="DIR", help="of lookout evaluate classes --examples")
    learn.add_argument("--regions", nargs=2, metavar=("CSV", "DIR"), help="labelled boxes (models/regions.csv) in the "
                       "pictures of a folder")
    learn.add_argument("--patches", metavar="DIR", help="folder with vehicles and non-vehicles")
    learn.add_argument("--judge", metavar="DIR", help="the same, only to report its last 30 %%")
    learn.add_argument("--shares", type=float, nargs=2, default=[0.63, 0.7], metavar=("LEARN", "VALIDATE"),
                       help="of each folder of patches: up to where to learn from, and to validate; the rest is held back")
    learn.add_argument("--epochs", type=int, default=30)
    learn.add_argument("--batch", type=int, default=64)
    learn.add_argument("--rate", type=float, default=4e-3)
    learn.add_argument("--seed", type=int, default=1)
    learn.add_argument("--check", metavar="FILE", help="log-odds of made-up pictures, for perception/tests/parity_network.rs")
    learn.add_argument("-o", "--out", required=True, metavar="FILE.onnx")
    learn.set_defaults(run=train)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
