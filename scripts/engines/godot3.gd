
# The job and its answer are those of drive.py; all balls of a job fly at once.
const BEFORE = 3
var job
var balls = []
var steps = 0
var seen = []

func _ready():
    var file = File.new()
    file.open("res://job.json", File.READ)
    job = JSON.parse(file.get_as_text()).result
    var rest = job.has("seconds")
    Physics2DServer.area_set_param(get_world_2d().space, Physics2DServer.AREA_PARAM_GRAVITY,
            9.81 * SCALE if rest else 0.0)
    make_court()
    if rest:
        put(0.0, 0.0, 0.0, job.height + job.radius)
        return
    for impact in job.impacts:
        for phase in job.phases:
            var height = job.radius + impact[1] / job.hertz * (BEFORE + phase)
            put(impact[0], impact[1], impact[2], height)

func put(v_x, v_y, omega, height):
    var ball = make_ball()
    for other in balls:
        ball.add_collision_exception_with(other)
    ball.position = Vector2(0.0, -height * SCALE)
    ball.linear_velocity = Vector2(v_x, v_y) * SCALE
    # In Godot's plane y points down: a positive turn is topspin of a ball that flies to the right.
    ball.angular_velocity = omega
    balls.append(ball)

func _physics_process(_dt):
    steps += 1
    if job.has("seconds"):
        var count = job.seconds * job.hertz
        if steps >= 0.9 * count:
            var ball = balls[0]
            var v = ball.linear_velocity / SCALE
            var height = -ball.position.y / SCALE - job.radius
            seen.append([height, abs(v.x), abs(v.y), abs(ball.angular_velocity)])
        if steps >= count:
            var lowest = seen[0][0]
            var most = seen[0].duplicate()
            for row in seen:
                lowest = min(lowest, row[0])
                for k in range(4):
                    most[k] = max(most[k], row[k])
            finish([most[0], lowest, most[1], most[2], most[3]])
    elif steps == 2 * BEFORE + 3:
        var after = []
        for ball in balls:
            var v = ball.linear_velocity / SCALE
            after.append([v.x, -v.y, ball.angular_velocity])
        finish(after)

func finish(answer):
    print(to_json(answer))
    get_tree().quit()
