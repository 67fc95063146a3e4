# The tables of a study's report in base R: conditions and the planned difference.

trials <- subset(read.csv("study/trials.csv"), practice == 0)
trials$value <- trials$gap_to_optimum_ratio

of_condition <- function(rows) {
  means <- tapply(rows$value, rows$participant, mean)
  data.frame(trials = nrow(rows), drivers = length(means), mean = mean(means), between = sd(means))
}
conditions <- do.call(rbind, by(trials, trials$presentation, of_condition))
conditions

same <- c("participant", "seed")
pairs <- merge(subset(trials, presentation == "speed-and-effort"), subset(trials, presentation == "none"), by = same)
pairs$difference <- pairs$value.x - pairs$value.y
drivers <- aggregate(difference ~ participant, pairs, mean)
test <- t.test(drivers$difference)
test
