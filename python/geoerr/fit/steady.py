"""Temperatures that hardly change: what they are multiplied with hides in a model, all but little."""

# What follows a temperature is judged about its mean where its variance is a smaller share of its mean square, both
# above what it is told from: a tenth of what follows it is as much as nothing is said of. One that rises evenly from
# there has a quarter.
STEADY = 0.02
