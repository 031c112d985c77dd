"""What is said of the options of `headland day` and `headland diagnose`, on the command line and in the API."""

DAY_HELP = {
    "farm": "A farm file instead of the one that the day file names.",
    "rain": "When it begins to rain, instead of the day file's rain.",
    "samples": "Samples of what varies from day to day.",
    "certainty": "Plan with times that this percentage of the samples keeps (50 to 99) instead of means.",
}
DIAGNOSIS_HELP = {
    "ground": "Ground the logs were made on: soil or asphalt.",
    "fix": "A convention to convert from, such as steering-left-positive; there may be several.",
    "column": "The column of the logs for one of ours: time_s=Zeit, speed_kmh=v; there may be several.",
    "as_driven": "Take the vehicle size from the logs where the tractor file differs.",
    "demo": "Hide an effect in simulated logs and find it.",
    "seed": "Seed of the demonstration, 1 by default.",
    "hide": "Effect to hide in the demonstration; random by default.",
    "holdout": "Keep runs out of everything, and give the error before and after on them: names or patterns (in "
    "quotes), #2 for the second run, how many, or auto.",
}
